"""Whole gardens: the same from the same seed, nothing floats, is buried or stands in something else."""

import json
import subprocess
import sys
from collections import Counter, defaultdict
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from swardmap.errors import ConfigError, InvalidValueError
from swardmap.labels import GRASS, OTHER, PERSON
from swardmap.synth.config import read_more
from swardmap.synth.model import Garden, Thing
from swardmap.synth.scene.areas import inside_convex_m
from swardmap.synth.scene.garden import build_garden
from swardmap.synth.terrain import Surface
from tests.synth.people.bodies import assets
from tests.synth.scene.gardens import (
    OUTLINES,
    SEEDS,
    STAMPS_NS,
    digest,
    garden,
    heights_m,
    outline,
    plain_garden,
    vertices,
)

ROOT = Path(__file__).parents[3]
DUG_IN_M = {
    "hedge": 0.4, "wall": 0.3, "house": 0.5, "shed": 0.15, "fence": 0.12, "wire": 0.12, "railing": 0.12,
    "tree": 0.35, "trellis": 0.25, "fountain": 0.25, "pole": 0.15, "shrub": 0.12, "raised bed": 0.12,
    "lamp post": 0.1, "flowers": 0.1, "ground cover": 0.1, "daisies": 0.15, "fallen leaves": 0.2,
    "washing line": 0.1, "sign": 0.1, "log": 0.1, "twigs": 0.1, "rock": 0.1, "stump": 0.1,
}  # fmt: skip
"""How deep the lowest part of what grows, is built or lies flat may be in the ground; all else SUNK_M."""
SUNK_M, HOVERS_M = 0.065, 0.03
LINES = {"fence", "hedge", "wall", "wire", "railing"}
CELL_M = 0.06

each_garden = pytest.mark.parametrize("seed", SEEDS)


def test_the_same_seed_gives_the_same_garden_and_another_another() -> None:
    assert digest(garden(3)) == digest(build_garden(3, assets())) != digest(garden(4))
    assert digest(plain_garden(3)) == digest(build_garden(3)) != digest(garden(3))


def test_another_machine_gives_the_same_garden() -> None:
    """Against a file made elsewhere; new after gardens were changed: python -m tests.synth.scene.gardens."""
    stored = json.loads(OUTLINES.read_text())
    for name, it in (("2", garden(2)), ("plain 1", plain_garden(1))):
        found, told = outline(it), stored[name]
        assert [row[0] for row in found["things"]] == [row[0] for row in told["things"]]
        here, there = ([row[1:] for row in side["things"]] for side in (found, told))
        assert np.allclose(here, there, atol=1e-3)
        assert np.allclose(found["heights_m"], told["heights_m"], atol=1e-3)
        assert found["lawn_m2"] == pytest.approx(told["lawn_m2"], rel=1e-4)


def test_a_garden_has_more_of_what_is_asked_for_and_all_else_by_the_same_chance() -> None:
    def count(it: Garden, kind: str) -> int:
        return sum(thing.kind == kind for thing in it.things)

    more = read_more("tree=6, hose=10,ball=0")
    seeds = range(4)
    usual, hard = ([build_garden(seed, None, m) for seed in seeds] for m in (None, more))
    for kind, times in more.items():
        before, now = (sum(count(it, kind) for it in gardens) for gardens in (usual, hard))
        assert (now > 2 * before) if times else (now == 0 < before), kind
    assert [it.lot_m.tolist() for it in usual] == [it.lot_m.tolist() for it in hard]
    assert (
        digest(build_garden(1, None, {}))
        == digest(build_garden(1))
        == digest(build_garden(1, None, {"hose": 1.0}))
    )


def test_a_garden_can_have_more_ground_cover() -> None:
    def covered_m2(more: dict[str, float]) -> float:
        grounds = [build_garden(seed, None, more).ground for seed in range(4)]
        return sum(float((g.surface == Surface.GROUND_COVER).sum()) * g.texel_m**2 for g in grounds)

    assert covered_m2({"ground cover": 10}) > 1.5 * covered_m2({}) > 0
    assert covered_m2({"ground cover": 0}) == 0


@pytest.mark.parametrize(
    "text", ["tree", "tree=", "tree=-1", "tree=21", "tree=nan", "tree=2,tree=3", "dragon=2", "=3"]
)
def test_an_unknown_kind_or_number_is_one_clear_error(text: str) -> None:
    with pytest.raises(
        ConfigError, match=r"^scene.more: .*(tree=5,hose=4|unknown kind '(dragon)?'; known: animal)"
    ):
        read_more(text)


@pytest.mark.slow
def test_another_process_gives_the_same_garden() -> None:
    code = (
        "from tests.synth.scene.gardens import digest, garden; import numpy as np; np.random.seed(9);"
        "garden(5); print(digest(garden(2)))"
    )
    told = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert told.stdout.strip() == digest(garden(2))


@each_garden
def test_nothing_floats_and_nothing_is_half_buried(seed: int) -> None:
    it = garden(seed)
    for thing in it.things:
        over, base = heights_m(thing, it.ground)
        told = f"{thing.kind} {thing.model.name}"
        hangs = 0.08 if thing.pose == "sitting" else 0.0  # feet of somebody who is held by a seat
        assert over.min() < 0.01 + hangs, f"{told} touches nothing"
        assert base.max() < HOVERS_M + hangs, f"a foot of {told} hovers"
        assert base.min() > -DUG_IN_M.get(thing.kind, SUNK_M), f"{told} is in the ground"


@each_garden
def test_who_moves_stays_on_the_ground_and_in_the_lot(seed: int) -> None:
    it = garden(seed)
    for actor in it.actors:
        for stamp_ns in STAMPS_NS:
            thing = actor.at(stamp_ns)
            over, _ = heights_m(thing, it.ground)
            flies = {"running": 0.12, "riding": 0.4}.get(thing.pose, 0.06)
            assert -0.08 < over.min() < flies, thing.model.name
            x, y = thing.T_map_model[:2, 3:4].astype(np.float32)
            assert inside_convex_m(it.lot_m, x, y)[0] > 0.3
            assert it.ground.is_lawn(thing.T_map_model[None, :2, 3]).all()


@each_garden
def test_things_stand_in_the_lot(seed: int) -> None:
    it = garden(seed)
    for thing in it.things:
        x, y = thing.T_map_model[:2, 3:4].astype(np.float32)
        assert inside_convex_m(it.lot_m, x, y)[0] > -0.1, thing.kind


def cells_of(thing: Thing, it: Garden) -> set[tuple[int, ...]]:
    """Cells of 6 cm that its surface passes through, 3 cm above the ground and more."""
    rng, found = np.random.default_rng(0), []
    for mesh in thing.model.meshes:
        corners = vertices(Thing(type(thing.model)("part", (mesh,)), thing.kind, thing.T_map_model))[
            mesh.faces
        ]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        pick = rng.choice(len(corners), int(np.clip(area.sum() / 0.005, 100, 20_000)), p=area / area.sum())
        u, v = np.sqrt(rng.random((len(pick), 1))), rng.random((len(pick), 1))
        a, b, c = np.moveaxis(corners[pick], 1, 0)
        found.append(a * (1 - u) + b * u * (1 - v) + c * u * v)
    points = np.concatenate(found)
    points = points[points[:, 2] > it.ground.height_at(points[:, :2]) + 0.03]
    return set(map(tuple, np.unique(np.floor(points / CELL_M).astype(int), axis=0)))


@each_garden
def test_things_are_not_inside_one_another(seed: int) -> None:
    """Surfaces of two things share at most a twelfth of the smaller one's cells.

    Pieces of one line meet, people sit on seats and bicycles, low plants may grow through each other.
    """
    it = garden(seed)
    solid = [t for t in it.things if t.label != GRASS and t.kind not in ("ground cover", "seat", "bicycle")]
    cells = [cells_of(thing, it) for thing in solid]
    shared = Counter[tuple[int, ...]]()
    owners: dict[tuple[int, ...], list[int]] = defaultdict(list)
    for k, mine in enumerate(cells):
        for cell in mine:
            owners[cell].append(k)
    for those in owners.values():
        shared.update(combinations(those, 2))
    for (a, b), count in shared.items():
        pair = {solid[a].kind, solid[b].kind}
        if not pair <= LINES:
            assert count < min(len(cells[a]), len(cells[b])) / 12, f"{pair} are in one another"


@each_garden
def test_labels_are_those_of_the_kind(seed: int) -> None:
    for thing in garden(seed).at(0):
        expected = {"person": PERSON, "daisies": GRASS, "fallen leaves": GRASS}.get(thing.kind, OTHER)
        assert thing.label == expected, thing.kind
        assert (thing.label == PERSON) <= (thing.pose != "")


@each_garden
def test_what_is_labelled_grass_is_low_and_on_the_lawn(seed: int) -> None:
    it = garden(seed)
    for thing in it.things:
        if thing.label == GRASS:
            over, _ = heights_m(thing, it.ground)
            assert over.max() < 0.1
            assert it.ground.is_lawn(thing.T_map_model[None, :2, 3]).all()


@each_garden
def test_every_part_of_what_sits_on_a_seat_is_above_it(seed: int) -> None:
    it = garden(seed)
    people = [t for t in it.things if t.label == PERSON and t.pose == "sitting"]
    seats = {tuple(t.T_map_model[:3, 3]): t for t in it.things if t.kind == "seat"}
    for who in people:
        seat = seats.get(tuple(who.T_map_model[:3, 3]))
        if seat is None:
            continue  # ready-made people who sit on the ground
        xyz = np.concatenate([mesh.xyz for mesh in who.model.meshes])
        top = np.concatenate([mesh.xyz for mesh in seat.model.meshes])
        middle = top[:, :2].mean(axis=0)
        over = xyz[np.linalg.norm(xyz[:, :2] - middle, axis=1) < 0.12, 2]
        assert over.size, "the seat is beside whoever sits"


def test_a_negative_seed_is_one_clear_error() -> None:
    with pytest.raises(InvalidValueError, match="expected a seed of 0 or more, got -1"):
        build_garden(-1)


KINDS = {
    "tree", "shrub", "hedge", "fence", "wall", "wire", "railing", "house", "shed", "pole", "lamp post",
    "bench", "chair", "table", "toy", "ball", "hose", "tool", "animal", "statue", "garden figure",
    "washing line", "laundry", "test body", "ground cover", "flowers", "flower pot", "raised bed", "trellis",
    "vehicle", "swing", "trampoline", "play", "wheelbarrow", "low object", "rock", "stump", "log", "twigs",
    "daisies", "fallen leaves", "person", "seat", "bin", "sign", "planter", "fountain", "tent", "playhouse",
    "bicycle",
}  # fmt: skip
POSES = {
    "standing", "waving", "pointing", "carrying", "pushing", "bending", "crouching", "kneeling", "sitting",
    "sitting_ground", "astride", "lying_back", "lying_side", "lying_front", "lying", "walking", "running",
    "riding",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_everything_that_is_told_of_comes_up_within_sixty_gardens() -> None:
    kinds, poses, surfaces = set[str](), set[str](), set[int]()
    for seed in range(60):
        it = build_garden(seed, assets())
        things = it.at(0)
        kinds |= {thing.kind for thing in things}
        poses |= {thing.pose for thing in things if thing.label == PERSON}
        surfaces |= set(np.unique(it.ground.surface[it.ground.lawn_m < 0]).tolist())
        if kinds >= KINDS and poses >= POSES and len(surfaces) == len(Surface) - 1:
            break
    assert kinds == KINDS
    assert poses == POSES
    assert surfaces == set(range(1, len(Surface)))


@pytest.mark.parametrize("seed", range(3))
def test_a_garden_without_assets_is_whole_too(seed: int) -> None:
    it = plain_garden(seed)
    assert {"tree", "shrub", "fence", "person"} & {thing.kind for thing in it.things}
    for thing in it.things:
        over, base = heights_m(thing, it.ground)
        assert over.min() < 0.01
        assert base.max() < HOVERS_M
