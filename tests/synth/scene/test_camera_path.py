"""The camera's way: on the lawn, clear of things, at a mower's speed, with people in view; rigs."""

import numpy as np
import pytest

from swardmap.errors import InvalidValueError
from swardmap.geometry import Intrinsics
from swardmap.labels import GRASS, PERSON
from swardmap.synth.model import Float64Array, Garden
from swardmap.synth.scene.camera_path import MowerCamera, mowing_run, random_rig
from swardmap.synth.scene.clearance import CELL_M, clearance_of
from swardmap.synth.scene.lanes import THINGS_M, there_and_back, timed
from tests.synth.scene.gardens import SEEDS, garden, vertices

FRAMES, RATE_HZ = 80, 5.0
each_garden = pytest.mark.parametrize("seed", SEEDS)
LENS = Intrinsics(640, 480, 580.0, 580.0, 319.5, 239.5)


def run_of(seed: int, rig: MowerCamera | None = None) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Seconds, places and viewing directions (n x 3) of the camera."""
    run = mowing_run(garden(seed), seed, FRAMES, RATE_HZ, rig)
    T = np.array([pose.matrix for _, pose in run])
    return np.array([stamp for stamp, _ in run]) * 1e-9, T[:, :3, 3], T[:, :3, 2]


def test_rigs_are_those_of_mowers() -> None:
    rigs = [random_rig(seed) for seed in range(400)]
    assert all(0.3 <= rig.height_m <= 1.3 and 10 <= rig.pitch_deg <= 30 for rig in rigs)
    for name, span in (("height_m", (0.3, 1.3)), ("pitch_deg", (10, 30))):
        assert np.histogram([getattr(rig, name) for rig in rigs], 5, span)[0].min() > 0.02 * len(rigs)
    for rig in rigs:
        lens = rig.intrinsics
        assert 54 < np.degrees(2 * np.arctan(lens.width / 2 / lens.fx)) < 64
        upper = np.radians(rig.pitch_deg) - np.arctan((lens.cy + 0.5) / lens.fy)
        assert upper <= 0 or rig.height_m / np.tan(upper) > 7.9


@each_garden
def test_the_camera_keeps_its_height_pitch_and_roll_over_the_ground(seed: int) -> None:
    rig = MowerCamera(LENS, height_m=0.7, pitch_deg=17, vibration_m=0, vibration_deg=0)
    _, place, ahead = run_of(seed, rig)
    it = garden(seed)
    over = place[:, 2] - it.ground.height_at(place[:, :2])
    assert np.abs(over - 0.7).max() < 0.15
    d = 0.2 * ahead[:, :2] / np.linalg.norm(ahead[:, :2], axis=1, keepdims=True)
    rise = it.ground.height_at(place[:, :2] + d) - it.ground.height_at(place[:, :2] - d)
    down = -np.degrees(np.arcsin(ahead[:, 2])) + np.degrees(np.arctan(rise / 0.4))
    assert np.abs(np.median(down) - 17) < 2


@each_garden
def test_the_mower_stays_on_the_lawn_clear_of_things_at_a_mowers_speed(seed: int) -> None:
    rig = MowerCamera(LENS, forward_m=0.0, left_m=0.0, vibration_m=0, vibration_deg=0)
    seconds, place, ahead = run_of(seed, rig)
    it = garden(seed)
    assert it.ground.is_lawn(place[:, :2]).all()
    for thing in it.things:
        if thing.label != GRASS:
            at = vertices(thing)
            low = at[at[:, 2] < thing.T_map_model[2, 3] + 1.0]
            gap = np.linalg.norm(place[:, None, :2] - low[None, ::7, :2], axis=2).min(initial=9)
            assert gap > THINGS_M - 0.1 - CELL_M, f"{thing.kind} in the way"
    step = np.linalg.norm(np.diff(place[:, :2], axis=0), axis=1) / np.diff(seconds)
    assert step.max() < 0.9  # the camera sways over the wheels
    assert step.mean() > 0.15
    heading = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    assert np.abs(np.diff(heading) / np.diff(seconds)).max() < 1.1


def test_people_are_ahead_most_of_the_time() -> None:
    shares = []
    for seed in SEEDS:
        seconds, place, ahead = run_of(seed)
        it = garden(seed)
        seen = np.zeros(FRAMES, bool)
        for k, second in enumerate(seconds):
            for thing in it.at(round(second * 1e9)):
                if thing.label == PERSON:
                    away = thing.T_map_model[:2, 3] - place[k, :2]
                    cosine = away @ ahead[k, :2] / np.linalg.norm(away) / np.linalg.norm(ahead[k, :2])
                    seen[k] |= np.linalg.norm(away) < 15 and cosine > np.cos(0.5)
        shares.append(seen.mean())
    assert np.mean(shares) > 0.5


def test_the_same_seed_gives_the_same_way_and_others_another() -> None:
    one, again, other = (mowing_run(garden(1), seed, 20, RATE_HZ) for seed in (1, 1, 2))
    assert [stamp for stamp, _ in one] == [round(k * 2e8) for k in range(20)]
    assert all(np.array_equal(a.matrix, b.matrix) for (_, a), (_, b) in zip(one, again, strict=True))
    assert not np.array_equal(one[5][1].matrix, other[5][1].matrix)


def test_distances_are_those_to_the_nearest_vertex_below() -> None:
    it, rng = garden(0), np.random.default_rng(0)
    clear = clearance_of(it)
    low, high = it.lot_m.min(axis=0), it.lot_m.max(axis=0)
    spots = rng.uniform(low + 0.5, high - 0.5, (200, 2))
    points = np.concatenate([
        at[at[:, 2] < thing.T_map_model[2, 3] + 1.4, :2]
        for thing in it.things if thing.label != GRASS
        for at in [vertices(thing)]
    ])  # fmt: skip
    nearest = np.array([np.linalg.norm(points - spot, axis=1).min() for spot in spots])
    assert (clear.room(spots) <= nearest + CELL_M).all()


def test_tall_things_hide_and_low_ones_do_not() -> None:
    it: Garden = garden(2)
    clear = clearance_of(it)
    boards = [t for t in it.things if t.kind in ("fence", "hedge", "wall") and
              vertices(t)[:, 2].max() > t.T_map_model[2, 3] + 1.1]  # fmt: skip
    assert boards
    for thing in boards[:10]:
        across = thing.T_map_model[:2, 1] / np.linalg.norm(thing.T_map_model[:2, 1])
        middle = thing.T_map_model[:2, 3]
        assert not clear.sees((middle - 3 * across)[None], (middle + 3 * across)[None])[0]
    assert clear.sees(np.array([[100.0, 100.0]]), np.array([[103.0, 100.0]]))[0]


def test_a_way_there_and_back_returns_and_takes_its_time() -> None:
    way = np.column_stack([np.linspace(0, 2, 101), np.zeros(101), np.zeros(101)])
    both = there_and_back(way)
    assert np.allclose(both[-1, :2], way[0, :2])
    assert both[-1, 2] == pytest.approx(np.pi)
    assert timed(way, 0.5)[-1] == pytest.approx(4.0)
    assert timed(both, 0.5)[-1] == pytest.approx(8.0 + np.pi / 0.9, rel=0.02)


def test_impossible_runs_and_rigs_are_one_clear_error() -> None:
    with pytest.raises(InvalidValueError, match="expected frames and a positive rate, got 0"):
        mowing_run(garden(0), 0, 0)
    with pytest.raises(InvalidValueError, match="expected a height in 0-3 m"):
        MowerCamera(LENS, height_m=9)
    with pytest.raises(InvalidValueError, match="vibrations of 0 or more"):
        MowerCamera(LENS, vibration_m=-1)
