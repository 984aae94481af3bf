"""Shapes against closed forms: volumes, extents, outward faces, and the transforms that move them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swardmap.errors import InvalidValueError
from swardmap.synth.model import Material, Mesh
from swardmap.synth.shapes import (
    beam,
    box,
    cards,
    cylinder,
    ellipsoid,
    joined,
    lathe,
    mesh_of,
    model_of,
    moved,
    placed,
    sphere,
    tube,
)

size = st.floats(0.05, 5.0)


def volume(mesh: Mesh) -> float:
    """By the divergence theorem: only right if every face of a closed mesh looks outward."""
    p = mesh.xyz[mesh.faces].astype(np.float64)
    return float(np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6)


def polygon_area(sides: int, radius: float) -> float:
    return float(sides / 2 * radius**2 * np.sin(2 * np.pi / sides))


SOLIDS: dict[str, tuple[Mesh, float]] = {
    "box": (box((1, 2, 3)), 6.0),
    "cylinder": (cylinder(0.5, 2.0, 24), 2 * polygon_area(24, 0.5)),
    "cone": (cylinder(0.5, 2.0, 24, 0.0), 2 / 3 * polygon_area(24, 0.5)),
    "beam": (beam((0, 0, 0), (1, 2, 3), (0.1, 0.2)), 0.02 * 14**0.5),
    "level beam": (beam((0, 0, 1), (4, 0, 1), (0.1, 0.2)), 0.08),
    "steep beam": (beam((0, 0, 0), (0, 0, 4), (0.1, 0.2)), 0.08),
    "lathed cylinder": (lathe([(0, 0), (0.5, 0), (0.5, 2), (0, 2)], 24), 2 * polygon_area(24, 0.5)),
    "straight tube": (tube([(0, 0, 0), (0, 3, 0)], 0.1, 8), 3 * polygon_area(8, 0.1)),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_have_their_volume_and_look_outward(name: str) -> None:
    mesh, expected = SOLIDS[name]
    assert volume(mesh) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("name", SOLIDS)
def test_normals_have_length_one_and_agree_with_the_faces(name: str) -> None:
    mesh, _ = SOLIDS[name]
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    p = mesh.xyz[mesh.faces].astype(np.float64)
    flat = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    assert ((flat * mesh.normals[mesh.faces].mean(axis=1)).sum(axis=1) > -1e-9).all()


def test_round_shapes_lie_on_their_surface() -> None:
    ball = sphere(0.7)
    np.testing.assert_allclose(np.linalg.norm(ball.xyz - [0, 0, 0.7], axis=1), 0.7, atol=1e-6)
    assert 0.95 * 4 / 3 * np.pi * 0.7**3 < volume(ball) < 4 / 3 * np.pi * 0.7**3
    egg = ellipsoid((0.3, 0.5, 0.2))
    np.testing.assert_allclose(np.square((egg.xyz - [0, 0, 0.2]) / [0.3, 0.5, 0.2]).sum(axis=1), 1, atol=1e-5)
    can = cylinder(0.4, 1.0).xyz
    radius = np.hypot(can[:, 0], can[:, 1])
    assert ((np.abs(radius - 0.4) < 1e-6) | (radius < 1e-6)).all()


def test_a_bent_tube_keeps_its_distance_from_the_axis() -> None:
    turn = np.linspace(0, np.pi / 2, 20)
    axis = np.stack((np.cos(turn), np.sin(turn), 0 * turn), axis=1)
    around = tube(axis, 0.05, 8).xyz.astype(np.float64)
    nearest = np.linalg.norm(around[:, None] - axis[None], axis=2).min(axis=1)
    assert nearest.max() < 0.05 + 1e-6
    assert np.isin(np.round(nearest, 5), [0.0, 0.05]).all(), "only the middles of the caps lie on the axis"


def test_a_tube_may_taper() -> None:
    mesh = tube([(0, 0, 0), (0, 0, 1)], [0.2, 0.1], 32)
    radius = np.hypot(mesh.xyz[:, 0], mesh.xyz[:, 1])
    assert radius[np.isclose(mesh.xyz[:, 2], 0)].max() == pytest.approx(0.2, abs=1e-6)
    assert radius[np.isclose(mesh.xyz[:, 2], 1)].max() == pytest.approx(0.1, abs=1e-6)


@settings(max_examples=30, deadline=None)
@given(size, size, size, st.floats(-3, 3), st.floats(0.2, 3), st.floats(0.2, 3))
def test_moving_turns_normals_rightly_under_uneven_scales(
    x: float, y: float, z: float, yaw: float, a: float, b: float
) -> None:
    T = placed(x, y, z, yaw, (a, b, 1.0))
    mesh = moved(cylinder(0.5, 1.0, 16), T)
    assert volume(mesh) == pytest.approx(a * b * polygon_area(16, 0.5), rel=1e-3)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    side = np.abs(mesh.normals[:, 2]) < 1e-6  # at right angles to the ellipse, not to the circle
    c, s = np.cos(yaw), np.sin(yaw)
    local = (mesh.xyz[side].astype(np.float64) - [x, y, z]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    expected = np.stack((local[:, 0] / a**2, local[:, 1] / b**2), axis=1)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    got = mesh.normals[side].astype(np.float64) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    np.testing.assert_allclose(got[:, :2], expected, atol=2e-3)


def test_cards_are_squares_that_face_where_they_should() -> None:
    rng = np.random.default_rng(0)
    facing = rng.normal(size=(20, 3))
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    centres = rng.normal(size=(20, 3))
    mesh = cards(centres, facing, 0.2, rng.uniform(0, 6, 20))
    quads = mesh.xyz.reshape(20, 4, 3).astype(np.float64)
    np.testing.assert_allclose(quads.mean(axis=1), centres, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(quads - np.roll(quads, 1, axis=1), axis=2), 0.2, atol=1e-6)
    p = mesh.xyz[mesh.faces].astype(np.float64)
    flat = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    np.testing.assert_allclose(
        flat / np.linalg.norm(flat, axis=1, keepdims=True), np.concatenate([facing] * 2), atol=1e-4
    )


def test_joining_keeps_every_triangle() -> None:
    parts = [box((1, 1, 1)), moved(sphere(0.3), placed(2, 0))]
    whole = joined(parts)
    assert volume(whole) == pytest.approx(sum(volume(part) for part in parts), rel=1e-5)
    assert len(whole.faces) == sum(len(part.faces) for part in parts)


def test_a_model_has_one_mesh_for_each_material() -> None:
    red, blue = Material((1, 0, 0)), Material((0, 0, 1))
    model = model_of("m", [box((1, 1, 1), red), sphere(1, material=blue), box((2, 1, 1), red)])
    assert [mesh.material for mesh in model.meshes] == [red, blue]
    low, high = model.bounds_m()
    np.testing.assert_allclose([low, high], [(-1, -1, 0), (1, 1, 2)], atol=1e-6)


def test_what_cannot_be_made_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="at least one mesh"):
        joined([])
    with pytest.raises(InvalidValueError, match="at least 2 x 3"):
        tube([(0, 0, 0)], 0.1)
    with pytest.raises(InvalidValueError, match="two points that differ"):
        beam((1, 1, 1), (1, 1, 1), (0.1, 0.1))
    with pytest.raises(InvalidValueError, match="faces of 3 vertices"):
        mesh_of(np.eye(3), np.eye(3), np.zeros((3, 2)), [[0, 1, 3]])
