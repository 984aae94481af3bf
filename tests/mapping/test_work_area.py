"""The work area: metres against geodesics, east and north against closed forms, cells against OpenCV."""

import math
import time

import cv2
import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.config import AreaConfig, CostmapConfig
from swardmap.errors import ConfigError, InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.labels import MapClass
from swardmap.mapping.costmap import LETHAL, NO_INFORMATION, build_costmap
from swardmap.mapping.geodesy import Projection
from swardmap.mapping.work_area import (
    AreaRole,
    Polygon,
    WorkArea,
    checked_ring,
    first_crossing,
    projected,
)

pyproj = pytest.importorskip("pyproj")
GEOD = pyproj.Geod(ellps="WGS84")
KINDS = ("tmerc", "topocentric", "utm")
PLACES = [(0.0, 0.0), (52.4, 16.9), (-33.9, 151.2), (69.6, 18.9), (48.1, 179.9999), (-54.8, -68.3)]
SQUARE = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
SPEC = GridSpec(0.1, 200, 160, (-5.0, -3.0))


def east_north_of(lat0: float, lon0: float, lat: float, lon: float) -> tuple[float, float]:
    """Textbook ECEF to ENU on WGS84, heights 0."""
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)

    def ecef(lat_deg: float, lon_deg: float) -> NDArray[np.float64]:
        p, q = math.radians(lat_deg), math.radians(lon_deg)
        n = a / math.sqrt(1 - e2 * math.sin(p) ** 2)
        return n * np.array([math.cos(p) * math.cos(q), math.cos(p) * math.sin(q), (1 - e2) * math.sin(p)])

    d = ecef(lat, lon) - ecef(lat0, lon0)
    p, q = math.radians(lat0), math.radians(lon0)
    east = -math.sin(q) * d[0] + math.cos(q) * d[1]
    north = -math.sin(p) * math.cos(q) * d[0] - math.sin(p) * math.sin(q) * d[1] + math.cos(p) * d[2]
    return float(east), float(north)


def around(lat: float, lon: float, distance_m: float) -> NDArray[np.float64]:
    """(24, 2) points at a geodesic distance, every 15 degrees of azimuth."""
    azimuths = np.arange(0, 360, 15.0)
    full = np.full_like(azimuths, 1.0)
    lons, lats, _ = GEOD.fwd(lon * full, lat * full, azimuths, distance_m * full)
    return np.stack([lons, lats], axis=-1)


@pytest.mark.parametrize("place", PLACES)
def test_distances_and_azimuths_are_the_geodesics(place: tuple[float, float]) -> None:
    lat, lon = place
    azimuths = np.deg2rad(np.arange(0, 360, 15.0))
    for kind, tolerance_m in (("tmerc", 1e-4), ("topocentric", 1e-4)):
        for distance_m in (10.0, 300.0, 1000.0):
            xy = Projection(lat, lon, kind=kind).to_map(around(lat, lon, distance_m))
            expected = distance_m * np.stack([np.sin(azimuths), np.cos(azimuths)], axis=-1)
            np.testing.assert_allclose(xy, expected, atol=tolerance_m)


@pytest.mark.parametrize("place", PLACES)
def test_utm_is_true_to_direction_and_off_by_its_known_scale(place: tuple[float, float]) -> None:
    lat, lon = place
    xy = Projection(lat, lon, kind="utm").to_map(around(lat, lon, 500.0))
    azimuths = np.deg2rad(np.arange(0, 360, 15.0))
    scale = np.hypot(*xy.T) / 500
    assert 0.9995 < scale.min() <= scale.max() < 1.0011  # 0.9996 at the middle of a zone
    turned = np.angle(np.exp(1j * (np.arctan2(xy[:, 0], xy[:, 1]) - azimuths)))
    assert np.abs(np.rad2deg(turned)).max() < 0.01  # the convergence, up to several degrees, is taken off


@pytest.mark.parametrize("place", PLACES)
def test_the_topocentric_plane_is_that_of_the_textbook(place: tuple[float, float]) -> None:
    lat, lon = place
    points = around(lat, lon, 1000.0)
    expected = [east_north_of(lat, lon, p[1], p[0]) for p in points]
    np.testing.assert_allclose(Projection(lat, lon, kind="topocentric").to_map(points), expected, atol=1e-6)


@given(
    st.floats(-80, 80), st.floats(-180, 180), st.floats(-360, 360), st.sampled_from(KINDS),
    st.floats(-1000, 1000), st.floats(-1000, 1000), st.floats(0, 2000),
)  # fmt: skip
def test_there_and_back_is_under_a_tenth_of_a_millimetre(
    lat: float, lon: float, heading: float, kind: str, x: float, y: float, alt: float
) -> None:
    projection = Projection(lat, lon, heading, kind, alt)
    gps = projection.to_gps([(x, y)])
    np.testing.assert_allclose(projection.to_map(gps), [(x, y)], atol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_the_heading_is_that_of_the_x_axis_from_east_to_north(kind: str) -> None:
    lat, lon = 52.4, 16.9
    lons, lats, _ = GEOD.fwd(lon, lat, 90.0 - 30.0, 100.0)  # azimuths count from north, clockwise
    xy = Projection(lat, lon, heading_deg=30.0, kind=kind).to_map([(lons, lats)])
    np.testing.assert_allclose(xy, [(100.0, 0.0)], atol=0.05)
    lons, lats, _ = GEOD.fwd(lon, lat, -30.0, 100.0)  # to the left of it
    xy = Projection(lat, lon, heading_deg=30.0, kind=kind).to_map([(lons, lats)])
    np.testing.assert_allclose(xy, [(0.0, 100.0)], atol=0.05)


def test_at_a_height_the_ground_is_larger() -> None:
    far = around(46.0, 8.0, 1000.0)
    low = np.hypot(*Projection(46.0, 8.0, kind="topocentric").to_map(far).T)
    high = np.hypot(*Projection(46.0, 8.0, kind="topocentric", alt_m=1600.0).to_map(far).T)
    np.testing.assert_allclose(high / low, 1 + 1600 / 6.38e6, rtol=2e-6)


def blob(rng: np.random.Generator, centre: tuple[float, float], radius_m: float) -> NDArray[np.float64]:
    """A star-shaped ring that never crosses itself."""
    n = int(rng.integers(4, 30))
    angles = (np.arange(n) + rng.uniform(0, 0.9, n)) / n * 2 * np.pi  # gaps below half a turn
    radii = rng.uniform(0.3, 1.0, len(angles)) * radius_m
    return np.stack([centre[0] + radii * np.cos(angles), centre[1] + radii * np.sin(angles)], axis=-1)


def by_opencv(spec: GridSpec, rings: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Signed distance in cells of each centre to the nearest edge: positive where inside by even-odd."""
    r, (x0, y0) = spec.resolution_m, spec.origin_m
    cells = [((ring - [x0, y0]) / r).astype(np.float32) for ring in rings]
    ways = [
        [[cv2.pointPolygonTest(c, (ix + 0.5, iy + 0.5), True) for ix in range(spec.width)]
         for iy in range(spec.height)]
        for c in cells
    ]  # fmt: skip
    edge = np.min(np.abs(ways), axis=0)
    inside = np.sum(np.array(ways) > 0, axis=0) % 2 == 1
    signed: NDArray[np.float64] = np.where(inside, edge, -edge)
    return signed


@given(st.integers(0, 2**32 - 1))
def test_cells_agree_with_opencv_away_from_the_edge(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spec = GridSpec(0.25, 40, 32, (-5.0, -4.0))
    outer, hole = blob(rng, (0, 0), 4.5), blob(rng, (0.2, 0.1), 1.0)
    for ring in (outer, hole):
        assume(shapely.Polygon(ring).area > 0.01)
        assume(np.abs(np.diff(ring, axis=0)).max(axis=1).min() > 1e-3)
    polygon = Polygon(AreaRole.BOUNDARY, (outer, hole))
    covered = polygon.covers(spec)
    # a hole may reach out of the outer ring, which even-odd would add: it cuts, and never adds
    signed = np.minimum(by_opencv(spec, [outer]), -by_opencv(spec, [hole]))
    sure = np.abs(signed) > 0.02
    np.testing.assert_array_equal(covered[sure], (signed > 0)[sure])
    for rings in ((outer[::-1], hole), (outer, hole[::-1]), (np.vstack([outer, outer[:1]]), hole)):
        np.testing.assert_array_equal(Polygon(AreaRole.BOUNDARY, rings).covers(spec), covered)


def test_areas_of_cells_are_those_of_the_polygons() -> None:
    rings = (SQUARE, SQUARE * 0.3 + 2)
    area = WorkArea((Polygon(AreaRole.BOUNDARY, rings), Polygon(AreaRole.EXCLUSION, (SQUARE * 0.2 + 6,))))
    free_m2 = (~area.keep_out(SPEC)).sum() * 0.1**2
    assert free_m2 == pytest.approx(100 - 9 - 4)
    assert area.area_m2 == pytest.approx(91)


def test_boundaries_add_up_and_exclusions_win() -> None:
    two = (
        Polygon(AreaRole.BOUNDARY, (SQUARE,)),
        Polygon(AreaRole.BOUNDARY, (SQUARE + np.array([5.0, 0.0]),)),
    )
    zone = Polygon(AreaRole.EXCLUSION, (SQUARE * 0.1 + 5,))
    free = ~WorkArea((*two, zone)).keep_out(SPEC)
    assert free.sum() * 0.1**2 == pytest.approx(150 - 1)
    only = WorkArea((zone,)).keep_out(SPEC)
    assert only.sum() * 0.1**2 == pytest.approx(1)  # without a boundary, all but the exclusion


def test_kept_out_cells_are_lethal_and_the_inside_stays_as_it_was() -> None:
    area = WorkArea((Polygon(AreaRole.BOUNDARY, (SQUARE,)),))
    classes = np.full(SPEC.shape, MapClass.UNKNOWN, np.uint8)
    classes[:, 60:] = MapClass.GRASS
    classes[80, 90] = MapClass.OBSTACLE
    config = CostmapConfig(inscribed_radius_m=0.2, inflation_radius_m=0.2, margin_m=0.4)
    grid = OccupancyGrid(SPEC, classes)
    without, costs = build_costmap(grid, config).costs, build_costmap(grid, config, [area]).costs
    out = area.keep_out(SPEC)
    assert (costs[out] == LETHAL).all()
    assert (costs >= np.where(without == NO_INFORMATION, 0, without)).all()
    unknown = ~out & (classes == MapClass.UNKNOWN)
    assert np.isin(costs[unknown], [NO_INFORMATION, 253]).all()  # never free
    inside = costs[:, 145:150]  # the last half metre before the fence x = 10 m, in grass
    row = inside[100 - 60]
    assert (row[-2:] == 253).all()  # the robot's radius counts at the boundary ...
    assert (row[:-2] < 253).all()  # ... and the margin of the cameras does not
    assert (costs[80, 86:95] == LETHAL).all()  # which it does at the obstacle


@given(st.integers(1, 252))
def test_a_price_on_the_outside_never_makes_unknown_drivable(cost: int) -> None:
    area = WorkArea((Polygon(AreaRole.BOUNDARY, (SQUARE,)),), cost=cost)
    classes = np.zeros(SPEC.shape, np.uint8)
    classes[::2] = MapClass.GRASS
    costs = build_costmap(OccupancyGrid(SPEC, classes), CostmapConfig(), [area]).costs
    assert (costs[1::2] == NO_INFORMATION).all()
    assert (costs[::2][area.keep_out(SPEC)[::2]] == cost).all()


def test_a_map_in_another_frame_is_refused() -> None:
    area = WorkArea((Polygon(AreaRole.BOUNDARY, (SQUARE,)),))
    with pytest.raises(InvalidValueError, match=r"'map', the map in 'odom'.*area.frame_id"):
        area.keep_out(GridSpec(0.1, 5, 5, frame_id="odom"))


def test_a_ring_that_crosses_itself_is_refused_and_says_where() -> None:
    bow = [(0, 0), (10, 10), (10, 0), (0, 10)]
    with pytest.raises(InvalidValueError, match="crosses itself: the edge after corner 0"):
        checked_ring(bow, "boundary 'lawn'")
    for wrong in ([(0, 0), (1, 1)], [(0, 0), (1, 1), (2, 2)], [(0, 0), (np.nan, 1), (1, 0)], [0, 1, 2]):
        with pytest.raises(InvalidValueError, match="corners"):
            checked_ring(wrong, "x")
    with pytest.raises(InvalidValueError, match="at most 10000"):
        checked_ring(np.random.default_rng(0).random((10_001, 2)), "x")
    assert len(checked_ring([(0, 0), (0, 0), (1, 0), (1, 1), (0, 0)], "x")) == 3


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=4, max_size=8, unique=True))
def test_crossings_are_those_of_exact_arithmetic(corners: list[tuple[int, int]]) -> None:
    def side(p: tuple[int, int], q: tuple[int, int], r: tuple[int, int]) -> int:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    n, crossing = len(corners), None
    edges = [(corners[i], corners[(i + 1) % n]) for i in range(n)]
    for i in range(n):
        for j in range(i + 1, n):
            (a, b), (c, d) = edges[i], edges[j]
            if side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0:
                crossing = crossing or (i, j)
    assert first_crossing(np.array(corners, np.float64)) == crossing


def test_a_field_far_from_its_datum_is_refused() -> None:
    ring = Projection(52.4, 16.9).to_gps(SQUARE)
    polygon = (Polygon(AreaRole.BOUNDARY, (ring,), "lawn"),)
    near = projected(polygon, AreaConfig(datum_lat=52.4, datum_lon=16.9))
    np.testing.assert_allclose(near.polygons[0].rings[0], SQUARE, atol=1e-4)
    swapped = (Polygon(AreaRole.BOUNDARY, (ring[:, ::-1],), "lawn"),)
    for polygons, lat, lon in ((swapped, 52.4, 16.9), (polygon, 52.4, 17.3), (polygon, -52.4, 16.9)):
        with pytest.raises(InvalidValueError, match="'lawn' lies more than 20 km from the datum"):
            projected(polygons, AreaConfig(datum_lat=lat, datum_lon=lon))
    with pytest.raises(ConfigError, match="datum_lat"):
        projected(polygon, AreaConfig())
    with pytest.raises(ConfigError, match="datum_lat"):
        AreaConfig(file="lawn.geojson")
    with pytest.raises(InvalidValueError, match=r"latitude -90\.\.90"):
        Projection(91.0, 0.0)


def test_a_field_across_the_date_line_is_one_field() -> None:
    datum = Projection(-17.0, 179.9999)
    ring = datum.to_gps(SQUARE * 10)
    assert ring[:, 0].min() < -179.9 < 179.9 < ring[:, 0].max()
    area = projected((Polygon(AreaRole.BOUNDARY, (ring,)),), AreaConfig(datum_lat=-17.0, datum_lon=179.9999))
    np.testing.assert_allclose(area.polygons[0].rings[0], SQUARE * 10, atol=1e-4)


def test_rings_of_as_many_corners_as_there_may_be_take_no_minutes() -> None:
    angles = np.linspace(0, 2 * np.pi, 9_900, endpoint=False)
    radii = 5 + 0.02 * np.sin(900 * angles)
    ring = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1)
    twisted = ring.copy()
    twisted[[4000, 6000]] = twisted[[6000, 4000]]
    started = time.process_time()
    area = WorkArea(tuple(Polygon(AreaRole.BOUNDARY, (ring + i,)) for i in range(20)))
    area.keep_out(SPEC)
    with pytest.raises(InvalidValueError, match="crosses itself: the edge after corner 3999"):
        checked_ring(twisted, "boundary")
    assert time.process_time() - started < 5


def test_a_hole_drawn_as_a_keyhole_only_touches_itself() -> None:
    keyhole = [
        (0, 0),
        (10, 0),
        (10, 10),
        (0, 10),
        (0, 5),
        (4, 5),
        (4, 6),
        (6, 6),
        (6, 4),
        (4, 4),
        (4, 5),
        (0, 5),
    ]
    covered = Polygon(AreaRole.BOUNDARY, (np.array(keyhole, np.float64),)).covers(SPEC)
    assert covered.sum() * 0.1**2 == pytest.approx(100 - 4)
