"""Things, corridors, margin and lawn on maps drawn by hand, and sums that do not depend on their order."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import reduce
from operator import add
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.config import Config, SourceConfig
from swardmap.errors import InvalidValueError
from swardmap.eval.safety import SafetyTally, ThingKind, judge, total_safety
from swardmap.eval.things import HEIGHT_CLASSES, TrueThing, TrueThings, find_things
from swardmap.eval.truth import true_pixels
from swardmap.geometry import Pose, mount_pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.synth.analytic_source import AnalyticGardens

SPEC = GridSpec(0.05, 120, 80, (0.0, -2.0))
CAMERA = mount_pose(0.5, 15.0, parent="map")
LAWN = np.full(SPEC.shape, MapClass.GRASS, np.uint8)


def at(x_m: float, y_m: float, size: int = 4) -> tuple[slice, slice]:
    """Rows and columns of a square of cells whose corner is at a place."""
    ix, iy = round((x_m - SPEC.origin_m[0]) / 0.05), round((y_m - SPEC.origin_m[1]) / 0.05)
    return slice(iy, iy + size), slice(ix, ix + size)


def thing(place: tuple[slice, slice], height: str = "20-50 cm") -> TrueThing:
    cells = np.zeros(SPEC.shape, np.bool_)
    cells[place] = True
    return TrueThing("pot", height, 1, np.flatnonzero(cells))


def judged(
    reference: NDArray[np.uint8], called: NDArray[np.uint8], *things: TrueThing, margin_m: float = 0.1
) -> SafetyTally:
    standing = np.zeros(SPEC.shape, np.bool_)
    for one in things:
        standing.ravel()[one.cells] = True
    truth = TrueThings(things, standing, np.zeros(SPEC.shape, np.bool_), True)
    return judge(OccupancyGrid(SPEC, reference), OccupancyGrid(SPEC, called), truth, CAMERA, margin_m)


def marked(*places: tuple[slice, slice], value: int = MapClass.OBSTACLE) -> NDArray[np.uint8]:
    classes = LAWN.copy()
    for place in places:
        classes[place] = value
    return classes


def test_a_thing_without_a_mark_is_missed_and_dangerous_only_if_called_free() -> None:
    place = at(1.5, 0.0)
    truth, pot = marked(place), thing(place)
    assert judged(truth, truth, pot).of_things() == (1, 0, 0)
    assert judged(truth, LAWN, pot).of_things() == (1, 1, 1)
    assert judged(truth, marked(place, value=MapClass.UNKNOWN), pot).of_things() == (1, 1, 0)
    beside = marked(at(1.5 + 0.25, 0.0, 1))  # centres two cells, 0.10 m, from the nearest of its cells
    assert judged(truth, beside, pot).of_things()[1] == 0
    assert judged(truth, marked(at(1.5 + 0.30, 0.0, 1)), pot).of_things()[1] == 1


def test_a_thing_marked_in_part_is_dangerous_beyond_the_margin() -> None:
    long = (slice(40, 44), slice(20, 40))  # one metre
    truth, hedge = marked(long), thing(long, "over 50 cm")
    half = marked((slice(40, 44), slice(20, 30)))
    tally = judged(truth, half, hedge)
    assert tally.of_things(height="over 50 cm") == (1, 0, 1)
    assert tally.of_things(height="person") == (0, 0, 0)
    assert judged(truth, half, hedge, margin_m=0.5).of_things() == (1, 0, 0)
    assert tally.count("obstacle_free") == 40
    assert tally.count("obstacle_free_beyond") == 4 * 8  # two columns are within 0.10 m of the mark


def test_a_corridor_is_missed_if_the_mark_comes_too_late() -> None:
    place = at(1.5, -0.1)
    truth, pot = marked(place), thing(place)
    found = judged(truth, truth, pot)
    assert found.count("corridor_thing") > 0
    assert found.count("corridor_missed") == 0
    missed = judged(truth, LAWN, pot)
    assert missed.count("corridor_missed") == missed.count("corridor_thing")
    late = judged(truth, marked(at(2.0, -0.1)), pot)
    assert late.count("corridor_missed") > 0
    unknown = judged(truth, marked(place, value=MapClass.UNKNOWN), pot)
    assert unknown.count("corridor_missed") == 0


def test_a_mark_on_clear_lawn_is_a_false_stop_and_costs_lawn() -> None:
    ghost = marked(at(1.5, -0.1))
    found = judged(LAWN, ghost)
    assert found.count("corridor_thing") == 0
    assert 0 < found.count("corridor_stopped") <= found.count("corridor_clear")
    assert judged(LAWN, LAWN).count("corridor_stopped") == 0
    kept = judged(LAWN, LAWN)
    assert kept.count("lawn_kept_near") == kept.count("lawn_near") > 0
    assert found.count("lawn_marked") > 16  # the margin is lawn that is not mown
    unseen = judged(np.zeros(SPEC.shape, np.uint8), ghost)
    assert unseen.count("corridor_clear") == 0  # nobody knows that it is clear


@given(st.integers(0, 10), st.floats(0, 0.5), st.floats(0, 0.5))
def test_a_wider_margin_is_never_less_safe(seed: int, one: float, other: float) -> None:
    rng = np.random.default_rng(seed)
    truth = np.where(rng.random(SPEC.shape) < 0.1, MapClass.OBSTACLE, MapClass.GRASS).astype(np.uint8)
    called = np.where(rng.random(SPEC.shape) < 0.03, MapClass.OBSTACLE, MapClass.GRASS).astype(np.uint8)
    narrow, wide = (judged(truth, called, margin_m=m) for m in sorted((one, other)))
    assert wide.count("obstacle_free_beyond") <= narrow.count("obstacle_free_beyond")
    assert wide.count("lawn_kept") <= narrow.count("lawn_kept")


KINDS = st.builds(
    ThingKind, st.sampled_from(["pot", "person"]), st.sampled_from(HEIGHT_CLASSES), st.integers(0, 4),
    st.booleans(), st.booleans(),
)  # fmt: skip
TALLIES = st.builds(
    lambda things, counts: SafetyTally(0.1, things, counts),
    st.dictionaries(KINDS, st.integers(1, 9)),
    st.dictionaries(st.sampled_from(["lawn", "obstacle"]), st.integers(1, 99)),
)


@given(st.lists(TALLIES, min_size=1, max_size=5), st.randoms())
def test_tallies_add_up_in_any_order_and_round_trip(tallies: list[SafetyTally], dice: Random) -> None:
    whole = total_safety(tallies, 0.1)
    shuffled = tallies[:]
    dice.shuffle(shuffled)
    assert reduce(add, shuffled).to_dict() == whole.to_dict()
    half = len(tallies) // 2
    parts = [total_safety(tallies[:half], 0.1), *tallies[half:]]
    assert total_safety(parts, 0.1).to_dict() == whole.to_dict()
    assert SafetyTally.from_dict(whole.to_dict()).to_dict() == whole.to_dict()


def test_other_margins_are_not_added() -> None:
    with pytest.raises(InvalidValueError, match=r"0\.1"):
        total_safety([SafetyTally(0.2)], 0.1)


def _of_frame(index: int) -> dict[str, object]:
    source = AnalyticGardens("analytic:scenes=2,frames=2,width=128,noise=0", SourceConfig())
    frame = source.clean_frame(index)
    pose: Pose = frame.T_map_camera  # type: ignore[assignment]
    config, truth = Config(), source.truth(index)
    pixels = true_pixels(frame, pose, config, truth)
    things = find_things(frame, pixels, pixels.cells(SPEC), SPEC, config, truth)
    grid = OccupancyGrid(SPEC, LAWN)
    return judge(grid, grid, things, pose, 0.1).to_dict()


def test_other_processes_count_the_same() -> None:
    here = [_of_frame(i) for i in range(4)]
    with ProcessPoolExecutor(2) as pool:
        there = list(pool.map(_of_frame, range(4)))
    assert there == here


def test_things_of_an_analytic_garden_are_its_solids() -> None:
    source = AnalyticGardens("analytic:scenes=1,frames=1,width=320,noise=0", SourceConfig())
    frame, truth, config = source.clean_frame(0), source.truth(0), Config()
    assert frame.T_map_camera is not None
    pixels = true_pixels(frame, frame.T_map_camera, config, truth)
    by_ids = find_things(frame, pixels, pixels.cells(SPEC), SPEC, config, truth)
    assert by_ids.has_ids
    assert by_ids.things
    assert {t.height for t in by_ids.things} <= set(HEIGHT_CLASSES)
    near = {int(i) for i in np.unique(truth.instances) if 0 < i < 60_000}  # type: ignore[arg-type]
    assert len(by_ids.things) <= len(near)
    without = find_things(frame, pixels, pixels.cells(SPEC), SPEC, config, None)
    assert not without.has_ids
    assert without.things  # connected cells stand for them
    covered = np.unique(np.concatenate([t.cells for t in by_ids.things]))
    for one in without.things:
        assert np.isin(one.cells, covered).mean() > 0.5


def test_a_frame_without_anything_near_shows_no_thing() -> None:
    source = AnalyticGardens("analytic:scenes=1,frames=1,width=128,noise=0", SourceConfig())
    frame, truth, config = source.clean_frame(0), source.truth(0), Config()
    assert frame.T_map_camera is not None
    far = replace(frame, depth=np.zeros_like(frame.depth))
    pixels = true_pixels(far, frame.T_map_camera, config, truth)
    seen = find_things(far, pixels, pixels.cells(SPEC), SPEC, config, truth)
    assert not seen.things
