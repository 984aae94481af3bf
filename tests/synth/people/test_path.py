"""Ways, and who moves along them: speed, ground, slope."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.errors import InvalidValueError
from swardmap.labels import OTHER, PERSON
from swardmap.synth.model import Model
from swardmap.synth.people.path import Mover, Path, cyclist, walker
from swardmap.synth.shapes import box
from swardmap.synth.terrain import Terrain
from tests.synth.people.bodies import assets

RING = Path(3.0 * np.stack((np.cos(np.arange(24) * np.pi / 12), np.sin(np.arange(24) * np.pi / 12)), 1), True)


def hill(slope_x: float, slope_y: float) -> Terrain:
    """An inclined plane of 20 m."""
    n, texel = 80, 0.25
    x, y = np.meshgrid((np.arange(n) + 0.5) * texel - 10, (np.arange(n) + 0.5) * texel - 10)
    one = np.ones((n, n), np.float32)
    z = (slope_x * x + slope_y * y).astype(np.float32)
    return Terrain((-10, -10), texel, z, one, (0 * one).astype(np.uint8), np.ones((n, n, 3), np.float32),
                  0.03 * one, one, 0 * one)  # fmt: skip


points = st.lists(
    st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=3, max_size=8, unique_by=lambda p: round(p[0], 1)
)


@given(points, st.booleans(), st.floats(0, 50))
def test_a_path_is_continuous_and_comes_back(xy: list[tuple[float, float]], closed: bool, way: float) -> None:
    path = Path(np.array(xy), closed)
    assert np.allclose(path.at(0), xy[0])
    assert np.allclose(path.at(way), path.at(way + path.length_m), atol=1e-6)
    assert np.linalg.norm(path.at(way + 0.1) - path.at(way)) <= 0.1 + 1e-9


@given(st.floats(0, 40))
def test_heading_is_the_tangent(way: float) -> None:
    x, y = RING.at(way)
    off = RING.heading_rad(way) - np.arctan2(x, -y)
    assert abs(np.angle(np.exp(1j * off))) < 0.15


def test_a_path_without_length_is_one_clear_error() -> None:
    with pytest.raises(InvalidValueError, match="at least 2 finite points"):
        Path(np.zeros((1, 2)))
    with pytest.raises(InvalidValueError, match="points that differ"):
        Path(np.zeros((3, 2)))


@pytest.mark.parametrize("running", [False, True])
def test_somebody_goes_at_the_speed_of_people(running: bool) -> None:
    rng = np.random.default_rng(3)
    who = walker(rng, assets(), RING, hill(0, 0), running=running)
    least, most = (1.2, 3.3) if running else (0.5, 1.6)
    assert least < who.speed_mps < most
    places = np.array([who.at(k * 100_000_000).T_map_model[:2, 3] for k in range(60)])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert np.allclose(steps, 0.1 * who.speed_mps, rtol=0.05)
    assert {who.at(k * 100_000_000).model.name for k in range(60)} <= {m.name for m in who.models}
    assert len({who.at(k * 100_000_000).model.name for k in range(60)}) > 8
    assert who.at(5).label == PERSON
    assert who.at(5).pose == ("running" if running else "walking")


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.1, 0.0), (-0.06, 0.09)])
def test_feet_and_wheels_are_on_the_ground_wherever_it_leads(slope: tuple[float, float]) -> None:
    ground, rng = hill(*slope), np.random.default_rng(1)
    goes = walker(rng, assets(), RING, ground, speed_mps=1.2)
    rides, bicycle = cyclist(rng, assets(), RING, ground)
    for stamp_ns in range(0, 12_000_000_000, 900_000_000):
        for actor, low_m, high_m in ((goes, -0.06, 0.05), (bicycle, -0.03, 0.03)):
            thing = actor.at(stamp_ns)
            xyz = np.concatenate([mesh.xyz for mesh in thing.model.meshes]).astype(np.float64)
            xyz = xyz @ thing.T_map_model[:3, :3].T + thing.T_map_model[:3, 3]
            lowest = (xyz[:, 2] - ground.height_at(xyz[:, :2])).min()
            assert low_m < lowest < high_m
        assert np.array_equal(rides.at(stamp_ns).T_map_model, bicycle.at(stamp_ns).T_map_model)


def test_who_moves_is_turned_by_a_true_rotation() -> None:
    who = walker(np.random.default_rng(2), assets(), RING, hill(0.1, -0.05), speed_mps=1.0)
    for stamp_ns in (0, 3_000_000_000, 7_700_000_000):
        R = who.at(stamp_ns).T_map_model[:3, :3]
        assert np.allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1)


def test_a_mover_bobs_but_never_sinks() -> None:
    ground = hill(0.05, 0)
    dog = Mover(Model("dog", (box((0.6, 0.2, 0.5)),)), "animal", RING, ground, 1.0)
    for stamp_ns in range(0, 5_000_000_000, 130_000_000):
        thing = dog.at(stamp_ns)
        over = thing.T_map_model[2, 3] - ground.height_at(thing.T_map_model[None, :2, 3])[0]
        assert 0 <= over <= 0.016
        assert thing.label == OTHER
