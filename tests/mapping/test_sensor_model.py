"""The sensor model: both twins agree, and what evidence may and may not do to a cell."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.config import EvidenceConfig, load_config
from swardmap.errors import ConfigError
from swardmap.grid import GridSpec
from swardmap.kernels import log_odds as kernel
from swardmap.labels import MapClass
from swardmap.mapping.sensor_model import Cells, Viewpoint, cells_passed, parameters, update_cells

CONFIG = EvidenceConfig()
NEAR = Viewpoint(0.5, 0.5, 80.0, 0.1)  # in the middle of the cell: confidence is 1
UNKNOWN, GRASS, OBSTACLE, PERSON = MapClass.UNKNOWN, MapClass.GRASS, MapClass.OBSTACLE, MapClass.PERSON


def random_cells(rng: np.random.Generator, shape: tuple[int, int]) -> Cells:
    return Cells(
        rng.integers(-1500, 4500, shape).astype(np.int16),
        rng.choice([0, 0, 700, 2500], shape).astype(np.int16),
        rng.integers(0, 4, shape).astype(np.uint8),
    )


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_twins_agree_bit_for_bit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = int(rng.integers(1, 30)), int(rng.integers(1, 30))
    points = rng.choice([0, 0, 0, 1, 2, 3, 4, 60], (*shape, 4)).astype(np.uint32)
    x, y, half, back = rng.uniform((-20, -20, 1, 0), (40, 40, 90, 0.4)).tolist()
    view = Viewpoint(x, y, half, back)
    limits = {"obstacle_limit": float(rng.uniform(1, 30)), "clear_at": float(rng.uniform(0.1, 0.8))}
    min_points = int(rng.integers(1, 5))
    min_grass_points = int(rng.integers(1, 5))
    model = parameters(EvidenceConfig(**limits), min_points, min_grass_points)
    passed = cells_passed(points, view, min_points, min_grass_points)
    also_passed = np.zeros(shape, np.bool_)
    kernel.cells_passed(points, view.x, view.y, view.back, min_points, min_grass_points, also_passed)
    np.testing.assert_array_equal(passed, also_passed)

    one, corner = random_cells(rng, shape), (int(rng.integers(0, 50)), int(rng.integers(0, 50)))
    two = Cells(one.evidence.copy(), one.person.copy(), one.classes.copy())
    update_cells(points, passed, view, corner, model, one)
    kernel.update_cells(
        points, passed, view.x, view.y, view.half, *corner, model, two.evidence, two.person, two.classes
    )
    for name in ("evidence", "person", "classes"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)


def points_of(map_class: MapClass, count: int = 10) -> NDArray[np.uint32]:
    points = np.zeros((1, 1, 4), np.uint32)
    points[0, 0, map_class] = count
    return points


def told(cells: Cells, *sightings: MapClass, passed: bool = False, view: Viewpoint = NEAR) -> list[int]:
    """Class of the one cell after each sighting; UNKNOWN stands for a frame that does not see it."""
    model, seen = parameters(CONFIG, 3), []
    for map_class in sightings:
        update_cells(points_of(map_class), np.full((1, 1), passed), view, (0, 0), model, cells)
        seen.append(int(cells.classes[0, 0]))
    return seen


def frames_to_clear(map_class: MapClass, sightings: int) -> int:
    cells = Cells.unknown(1, 1)
    told(cells, *[map_class] * sightings)
    return told(cells, *[GRASS] * 60).index(GRASS) + 1


def test_unknown_needs_grass_to_be_free() -> None:
    cells = Cells.unknown(1, 1)
    assert told(cells, UNKNOWN, UNKNOWN) == [UNKNOWN, UNKNOWN]
    assert told(cells, UNKNOWN, passed=True) == [UNKNOWN]  # a ray over it says nothing of the ground
    assert told(cells, GRASS) == [GRASS]


@pytest.mark.parametrize("map_class", [OBSTACLE, PERSON])
def test_a_hazard_needs_more_to_clear_than_to_mark(map_class: MapClass) -> None:
    cells = Cells.unknown(1, 1)
    assert told(cells, map_class) == [map_class]
    assert CONFIG.mark_at + CONFIG.clear_at > CONFIG.grass_gain  # so one frame of grass never clears
    assert frames_to_clear(map_class, 1) > 1
    assert frames_to_clear(map_class, 50) >= frames_to_clear(map_class, 1)


def test_years_of_an_obstacle_are_cleared_within_a_bounded_number_of_frames() -> None:
    worst = int(np.ceil((CONFIG.obstacle_limit + CONFIG.clear_at) / CONFIG.grass_gain))
    assert frames_to_clear(OBSTACLE, 10_000) <= worst
    person = int(np.ceil((CONFIG.person_limit + CONFIG.clear_at) / CONFIG.grass_gain))
    assert frames_to_clear(PERSON, 10_000) <= person < worst


def test_a_person_on_lawn_long_known_is_marked_at_once_an_obstacle_soon() -> None:
    cells = Cells.unknown(1, 1)
    told(cells, *[GRASS] * 1000)
    assert told(cells, PERSON) == [PERSON]
    cells = Cells.unknown(1, 1)
    told(cells, *[GRASS] * 1000)
    assert told(cells, OBSTACLE, OBSTACLE)[-1] == OBSTACLE


def test_what_is_not_seen_stays_what_it_was() -> None:
    cells = Cells.unknown(1, 1)
    told(cells, OBSTACLE, OBSTACLE)
    before = int(cells.evidence[0, 0])
    assert told(cells, *[UNKNOWN] * 1000)[-1] == OBSTACLE  # a blind zone forgets nothing
    assert cells.evidence[0, 0] == before


def test_a_ray_that_passed_makes_a_hazard_unknown_and_never_free() -> None:
    cells = Cells.unknown(1, 1)
    told(cells, OBSTACLE)
    seen = told(cells, *[UNKNOWN] * 200, passed=True)
    assert seen[0] == OBSTACLE
    assert seen[-1] == UNKNOWN
    assert GRASS not in seen


def test_a_person_stays_one_until_cleared_and_an_obstacle_is_not_made_one_by_a_flicker() -> None:
    cells = Cells.unknown(1, 1)
    told(cells, *[PERSON] * 3)
    assert set(told(cells, GRASS, GRASS)) == {int(PERSON)}
    cells = Cells.unknown(1, 1)
    told(cells, *[OBSTACLE] * 10)
    frames = int(np.ceil(CONFIG.person_gain / CONFIG.obstacle_gain))
    assert told(cells, PERSON, *[OBSTACLE] * frames) == [*[PERSON] * frames, OBSTACLE]


def test_a_near_sighting_outweighs_a_far_one() -> None:
    near, far = Cells.unknown(1, 1), Cells.unknown(1, 1)
    told(near, OBSTACLE)
    told(far, OBSTACLE, view=Viewpoint(0.5 + 80.0, 0.5, 80.0, 0.1))
    assert int(near.evidence[0, 0]) == 2 * int(far.evidence[0, 0])


def test_rays_pass_low_before_the_grass_they_end_on_and_stop_at_a_hazard() -> None:
    points = np.zeros((1, 100, 4), np.uint32)
    points[0, 90, GRASS] = 3
    view = Viewpoint(0.5, 0.5, 80.0, 0.1)
    assert np.flatnonzero(cells_passed(points, view, 3)[0]).tolist() == list(range(81, 90))
    points[0, 85, OBSTACLE] = 3
    assert np.flatnonzero(cells_passed(points, view, 3)[0]).tolist() == list(range(86, 90))
    points[0, 90] = 0
    assert not cells_passed(points, view, 3).any()


def test_the_low_part_of_a_ray_is_that_below_the_stated_height() -> None:
    eye = (1.0, 2.0, 0.9)
    view = Viewpoint.of(eye, 0.9, GridSpec(0.1, 4, 4, (0.5, 0.5)), CONFIG, lowest_m=0.0)
    assert (view.x, view.y) == pytest.approx((5.0, 15.0))
    assert view.back == pytest.approx(CONFIG.ray_height_m / 0.9)
    beneath = Viewpoint.of(eye, 0.9, GridSpec(0.1, 4, 4), CONFIG, lowest_m=0.85)
    assert beneath.back == 0.0  # a camera as low as that clears nothing
    unknown = Viewpoint.of(eye, None, GridSpec(0.1, 4, 4), CONFIG, lowest_m=0.0)
    assert unknown.back == 0.0  # nor does one that does not know the ground


@pytest.mark.parametrize(
    ("override", "match"),
    [("evidence.person_limit=0.01", "at least mark_at"), ("evidence.free_limit=0.01", "at least free_at"),
     ("evidence.obstacle_limit=31", "at most 30"), ("grid.mode=hope", "last_seen, log_odds")],
)  # fmt: skip
def test_settings_that_contradict_each_other_are_refused(override: str, match: str) -> None:
    with pytest.raises(ConfigError, match=match):
        load_config(overrides=[override])
