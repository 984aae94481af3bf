"""The rendered garden that a mower drives through live."""

import numpy as np
import pytest

from swardmap.geometry import project
from swardmap.synth.live_garden import BED_HALF_M, BED_M
from swardmap.synth.rendered_garden import CAMERA, RenderedGarden

pytest.importorskip("moderngl", reason="gardens are drawn with moderngl (pip install 'swardmap[synth]')")


@pytest.fixture(scope="module")
def garden() -> RenderedGarden:
    return RenderedGarden()


Place = tuple[float, float, float]


def depth_of(garden: RenderedGarden, x_m: float, seconds: float, place_m: Place) -> tuple[float, float]:
    """What the camera reads around a place, with the mower at x; and how far it is."""
    T_map_base = garden.base_at(x_m, 0.0, 0.0)
    frame = garden.look(T_map_base, round(seconds * 1e9))
    point = (T_map_base @ garden.T_base_camera).inverse().apply(np.array([place_m]))
    pixels, _ = project(point, CAMERA)
    (u, v), far_m = pixels[0], float(point[0, 2])
    window = frame.depth_m[
        round(v) - 9 : round(v) + 10, round(u) - 9 : round(u) + 10
    ]  # wood is plain: stereo has holes
    return float(np.median(window[window > 0])), far_m


@pytest.mark.slow
def test_bed_and_visitor_are_where_they_are_said_to_be(garden: RenderedGarden) -> None:
    front = BED_M[0] - BED_HALF_M[0]
    seen_m, far_m = depth_of(garden, 1.0, 0.0, (front, BED_M[1], 0.15))
    assert seen_m == pytest.approx(far_m, abs=0.15)
    garden.begin_visit(0)
    standing_s = garden.visit.length_m / garden.visit.speed_mps + 1
    x, y = garden.visit.position_m(round(standing_s * 1e9))
    seen_m, far_m = depth_of(garden, 0.8, standing_s, (x, y, 0.6))
    assert seen_m == pytest.approx(far_m, abs=0.3)
    garden.begin_visit(None)
    away_m, _ = depth_of(garden, 0.8, standing_s, (x, y, 0.6))
    assert away_m > far_m + 0.5


@pytest.mark.slow
def test_the_mower_starts_at_the_origin_and_stands_on_the_ground(garden: RenderedGarden) -> None:
    T = garden.base_at(0.0, 0.0, 0.0).matrix
    np.testing.assert_allclose(T[:2, 3], 0, atol=0.02)
    assert abs(T[2, 3]) < 0.05
    assert T[0, 0] > 0.98
    assert garden.base_at(3.0, 1.0, 0.0).matrix[:2, 3] == pytest.approx((3.0, 1.0), abs=0.02)
