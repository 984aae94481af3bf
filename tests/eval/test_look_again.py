"""Things of single frames: the list agrees with what was counted, and says how far each is off its marks."""

import numpy as np
import pytest

from swardmap.config import config_from_dict
from swardmap.eval.dataset import DatasetSpec
from swardmap.eval.frame import Plan
from swardmap.eval.gathered import alone
from swardmap.eval.look_again import SeenThing, look_again, seen_things, stake, worst_things
from swardmap.eval.maps import compare_maps
from swardmap.eval.results import results
from swardmap.eval.run import evaluate, make_plan
from swardmap.eval.things import TrueThing
from swardmap.eval.worst import worst_frames
from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass

SPEC = GridSpec(0.1, 40, 30)
CAMERA = Pose("map", "camera", np.eye(4))
OBSTACLE, GRASS, UNKNOWN = int(MapClass.OBSTACLE), int(MapClass.GRASS), int(MapClass.UNKNOWN)


def seen(predicted: dict[int, int], cells: list[int]) -> SeenThing:
    """A thing on the cells of row 0, with what is predicted there."""
    truth, map_ = (OccupancyGrid(SPEC, np.full(SPEC.shape, GRASS, np.uint8)) for _ in range(2))
    truth.classes[0, cells] = OBSTACLE
    for column, value in predicted.items():
        map_.classes[0, column] = value
    thing = TrueThing("post", "20-50 cm", 0, np.array(cells))
    (found,) = seen_things(compare_maps(truth, map_), [thing], CAMERA)
    return found


def test_a_thing_needs_the_margin_that_reaches_its_farthest_free_cell() -> None:
    partly = seen({10: OBSTACLE}, [10, 11, 12, 13])
    assert (partly.missed, partly.free_cells, partly.cells) == (False, 3, 4)
    assert partly.needs_m == pytest.approx(0.3)
    assert partly.is_dangerous(0.29)
    assert not partly.is_dangerous(0.3)
    assert partly.xy_m == (1.35, 0.05)
    assert partly.away_m == pytest.approx(np.hypot(1.05, 0.05), abs=0.01)
    covered = seen(dict.fromkeys([10, 11], OBSTACLE), [10, 11])
    assert (covered.needs_m, covered.is_dangerous(0.0)) == (0.0, False)
    missed = seen({30: OBSTACLE}, [10, 11])
    assert missed.missed
    assert missed.needs_m == pytest.approx(2.0)
    unknown = seen({30: OBSTACLE, 10: UNKNOWN, 11: UNKNOWN}, [10, 11])
    assert (unknown.missed, unknown.is_dangerous(0.0)) == (True, False)
    nothing = seen({}, [10])
    assert nothing.needs_m is None
    assert nothing.is_dangerous(9.0)
    worst = sorted([covered, unknown, partly, missed, nothing], key=stake)
    assert worst == [nothing, missed, partly, unknown, covered]


@pytest.fixture(scope="module")
def run() -> Plan:
    config = config_from_dict({"segmenter": {"name": "colour"}})
    return make_plan(DatasetSpec("analytic:scenes=2,frames=2,width=128"), config, with_budget=False)


def test_the_list_agrees_with_the_counts(run: Plan, tmp_path: object) -> None:
    records = evaluate(run, tmp_path, workers=1)  # type: ignore[arg-type]
    found = results(run, records)
    again = worst_frames(alone(run, records), found, most=4)
    assert len(again) == 4
    things = [thing for _, frame in again for thing in frame.things]
    counted = found["metrics"]["overall"]
    assert len(things) == counted["things_missed"]["of"] > 0
    assert sum(t.missed for t in things) == counted["things_missed"]["count"]
    assert sum(t.is_dangerous(run.margin_m) for t in things) == counted["things_dangerous"]["count"]
    listed = worst_things(again, run.margin_m)
    assert [t["dangerous"] for t in listed] == sorted((t["dangerous"] for t in listed), reverse=True)


def test_a_frame_that_cannot_be_read_any_more_is_none(run: Plan) -> None:
    assert look_again(run, 99) is None
    gone = Plan(DatasetSpec("/nowhere/at/all"))
    assert look_again(gone, 0) is None
