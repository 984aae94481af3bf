"""People in poses: they touch the ground, are as high as their pose, turned outward."""

import numpy as np
import pytest

from swardmap.errors import InvalidValueError
from swardmap.synth.people.body import ARM
from swardmap.synth.people.figure import GROUPS, Person, figure_of, person
from swardmap.synth.people.poses import POSES
from tests.synth.people.bodies import assets, points_of

# lowest and highest point of the head above the ground, as shares of the height of the body
HIGHEST = {
    "standing": (0.93, 1.16), "waving": (0.93, 1.3), "pointing": (0.9, 1.16), "carrying": (0.9, 1.16),
    "pushing": (0.7, 1.12), "bending": (0.4, 0.95), "crouching": (0.45, 0.85), "kneeling": (0.4, 0.92),
    "sitting": (0.65, 0.95), "sitting_ground": (0.4, 0.75), "lying_back": (0.1, 0.5),
    "lying_side": (0.15, 0.5), "lying_front": (0.1, 0.5),
}  # fmt: skip


def somebody(pose: str, seed: int, group: str | None = None) -> Person:
    return person(np.random.default_rng([seed, 3]), assets(), pose, group)


def test_all_poses_are_measured() -> None:
    assert HIGHEST.keys() == POSES.keys()


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("seed", [0, 1])
def test_somebody_stands_on_the_ground_and_is_as_high_as_the_pose(pose: str, seed: int) -> None:
    who = somebody(pose, seed)
    low, high = who.model.bounds_m()
    assert low[2] == pytest.approx(0, abs=1e-5)
    assert np.allclose(low[:2], -high[:2], atol=1e-5)
    least, most = HIGHEST[pose]
    hat_m = 0.08
    assert least * who.height_m < high[2] < most * who.height_m + hat_m
    assert (who.seat_m > 0.25 * who.height_m * 0.6) == (pose == "sitting")
    assert who.seat_m < 0.36 * who.height_m


@pytest.mark.parametrize("pose", ["lying_back", "lying_side", "lying_front"])
def test_somebody_who_lies_is_long_and_flat(pose: str) -> None:
    who = somebody(pose, 4)
    low, high = who.model.bounds_m()
    assert max(high[:2] - low[:2]) > 0.6 * who.height_m
    half = np.median(points_of(who.model.meshes)[:, 2])
    assert half < 0.16 * who.height_m


@pytest.mark.parametrize("pose", ["standing", "crouching", "lying_back"])
def test_faces_are_turned_to_the_side_of_their_normals(pose: str) -> None:
    against = total = 0
    for mesh in somebody(pose, 2).model.meshes:
        corners = mesh.xyz.astype(np.float64)[mesh.faces]
        faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        real = np.linalg.norm(faces, axis=1) > 1e-9
        mean = mesh.normals[mesh.faces].sum(axis=1)
        against += int((((faces * mean).sum(axis=1) < 0) & real).sum())
        total += int(real.sum())
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-3)
    assert total > 5000
    assert against < 0.01 * total


@pytest.mark.parametrize("group", GROUPS)
def test_clothes_and_skin_look_outward(group: str) -> None:
    """From the middle of the trunk, the faces of what is worn on it look away."""
    figure = figure_of(np.random.default_rng([5, 3]), assets(), group)
    at = dict(zip(figure.body.bones, figure.body.joints, strict=True))
    middle = (at["waist"] + at["chest"]) / 2
    top = next(worn for worn in figure.worn if worn.what == "top").shell
    centre = top.xyz[top.faces].mean(axis=1) - middle
    near = (np.abs(centre[:, 2]) < 0.06 * figure.body.height_m) & (top.along[top.faces, ARM] < 0).all(axis=1)
    a, b, c = np.moveaxis(top.xyz[top.faces[near]], 1, 0)
    outward = (np.cross(b - a, c - a) * (centre[near] * [1, 1, 0])).sum(axis=1)
    assert near.sum() > 50
    assert (outward > 0).mean() > 0.9


def test_the_same_state_gives_the_same_person_and_others_differ() -> None:
    one, again, other = somebody("standing", 8), somebody("standing", 8), somebody("standing", 9)
    assert one.model.name != other.model.name
    for a, b in zip(one.model.meshes, again.model.meshes, strict=True):
        assert np.array_equal(a.xyz, b.xyz)
        assert np.array_equal(a.faces, b.faces)
        assert a.material.color == b.material.color
    assert abs(one.height_m - other.height_m) > 1e-3


def test_people_of_all_groups_come_up_and_clothes_vary() -> None:
    people = [somebody("standing", seed) for seed in range(25)]
    assert {who.group for who in people} == set(GROUPS)
    colors = {
        tuple(mesh.material.texture.rgba[32, 32])
        for who in people
        for mesh in who.model.meshes
        if mesh.material.texture is not None
    }
    assert len(colors) > 50


def test_nobody_lies_on_a_hat() -> None:
    for seed in range(6):
        figure = figure_of(np.random.default_rng(seed), assets(), "woman", lies=True)
        assert {worn.what for worn in figure.worn} <= {
            "face", "skin", "top", "trousers", "skirt", "vest", "shoes", "soles", "hair",
        }  # fmt: skip


def test_an_unknown_pose_is_one_clear_error() -> None:
    with pytest.raises(InvalidValueError, match=r"expected a pose of standing, .*got 'flying'"):
        somebody("flying", 0)
