"""The analytic garden against closed forms, SciPy-free geometry and brute force."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from swardmap.errors import FrameMismatchError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose, deproject, mount_pose, project
from swardmap.grid import GridSpec
from swardmap.labels import GRASS, OTHER, PERSON, VOID_ID, MapClass
from swardmap.synth.analytic import (
    VGA,
    AnalyticSource,
    Box,
    Cylinder,
    Ellipsoid,
    Patch,
    Scene,
    StereoNoise,
    Walker,
    garden_scene,
    lane_poses,
    render,
    sphere,
    true_map,
    with_sensor_noise,
)
from swardmap.synth.analytic_solids import Solid
from swardmap.types import Frame
from tests.io.contract import check_source

SMALL = Intrinsics(81, 61, 60.0, 60.0, 40.0, 30.0)
LEVEL = mount_pose(1.0, 0.0, parent="map")  # 1 m high, looks along +x
STEEP = mount_pose(0.9, 30.0, parent="map")


def depth_of(scene: Scene, T_map_camera: Pose = LEVEL, intrinsics: Intrinsics = SMALL) -> np.ndarray:
    return render(scene, intrinsics, T_map_camera, exact=True, max_depth_m=1e4).depth.astype(np.float64)


def test_the_lawn_has_the_depth_of_a_plane() -> None:
    depth = depth_of(Scene(), STEEP)
    v = (np.arange(61) - 30.0) / 60.0
    below = np.sin(np.deg2rad(30)) + v * np.cos(np.deg2rad(30))  # descent per metre of depth
    for row in range(61):
        expected = 0.9 / below[row] if below[row] > 0 and 0.9 / below[row] < 1e4 else 0.0
        np.testing.assert_allclose(depth[row], expected, rtol=1e-6)


def test_solids_ahead_have_the_depth_of_their_front() -> None:
    def ahead(*solids: Box | Cylinder | Ellipsoid) -> float:
        return float(depth_of(Scene(solids))[30, 40])

    assert ahead(sphere((5.0, 0, 1.0), 0.5)) == pytest.approx(4.5)
    assert ahead(Box((5.0, 0), (1.0, 2.0, 2.0))) == pytest.approx(4.5)
    assert ahead(Box((5.0, 0), (1.0, 1.0, 2.0), yaw_deg=45)) == pytest.approx(5 - 0.5**0.5)
    assert ahead(Cylinder((5.0, 0), 0.25, 2.0)) == pytest.approx(4.75)
    assert ahead(Ellipsoid((5.0, 0, 1.0), (0.3, 1.0, 0.4))) == pytest.approx(4.7)
    assert ahead(sphere((5.0, 0, 1.0), 0.5), Box((3.0, 0), (1.0, 2.0, 2.0))) == pytest.approx(2.5)
    assert ahead(sphere((-5.0, 0, 1.0), 0.5)) == 0, "what is behind the camera is not seen"


def test_depth_is_along_the_axis_not_along_the_ray() -> None:
    depth = depth_of(Scene((Box((5.5, 0), (1.0, 50.0, 50.0)),)))
    np.testing.assert_allclose(depth[:31], 5.0, rtol=1e-6)


def test_the_top_of_a_low_cylinder_is_flat() -> None:
    frame = render(Scene((Cylinder((1.5, 0), 0.4, 0.3),)), SMALL, STEEP, exact=True)
    points = STEEP.apply(deproject(frame.depth_m, SMALL)[frame.labels == OTHER.id])
    on_top, on_side = (
        np.abs(points[:, 2] - 0.3) < 1e-5,
        np.abs(np.hypot(points[:, 0] - 1.5, points[:, 1]) - 0.4) < 1e-5,
    )
    assert (on_top | on_side).all()
    assert on_top.sum() > 20
    assert on_side.sum() > 20


@settings(max_examples=60, deadline=None)
@given(
    xy=st.tuples(st.floats(1.0, 6.0), st.floats(-2.0, 2.0)),
    sizes=st.tuples(st.floats(0.05, 0.8), st.floats(0.05, 0.8), st.floats(0.1, 1.5)),
    yaw=st.floats(-180, 180),
    base=st.floats(0, 0.5),
    kind=st.sampled_from(["box", "cylinder", "ellipsoid"]),
)
@example(
    xy=(1.0, 0.0), sizes=(0.5, 0.5, 1.0), yaw=2.2e-311, base=0.0, kind="box"
)  # rays all but along a face
def test_every_point_seen_lies_on_the_surface_it_is_labelled_with(
    xy: tuple[float, float], sizes: tuple[float, float, float], yaw: float, base: float, kind: str
) -> None:
    solids: dict[str, Solid] = {
        "box": Box(xy, sizes, yaw, base),
        "cylinder": Cylinder(xy, sizes[0], sizes[2], base),
        "ellipsoid": Ellipsoid((*xy, base + sizes[2]), sizes),
    }
    frame = render(Scene((solids[kind],)), SMALL, STEEP, exact=True, max_depth_m=1e3)
    points = STEEP.apply(deproject(frame.depth_m, SMALL))
    seen = np.isfinite(points[..., 2])
    on_lawn, on_solid = seen & (frame.labels == GRASS.id), frame.labels == OTHER.id
    assert np.abs(points[on_lawn][:, 2] / frame.depth[on_lawn]).max(initial=0) < 1e-5
    local = points[on_solid] - [*xy, 0]
    if kind == "box":
        c, s = np.cos(np.deg2rad(yaw)), np.sin(np.deg2rad(yaw))
        turned = np.column_stack((local[:, :2] @ [[c, -s], [s, c]], local[:, 2] - base - sizes[2] / 2))
        off = np.abs((np.abs(turned) / (np.asarray(sizes) / 2)).max(axis=1) - 1)
    elif kind == "cylinder":
        r, z = (
            np.hypot(local[:, 0], local[:, 1]) / sizes[0],
            np.abs(local[:, 2] - base - sizes[2] / 2) / sizes[2] * 2,
        )
        off = np.abs(np.maximum(r, z) - 1)
    else:
        off = np.abs(np.linalg.norm((local - [0, 0, base + sizes[2]]) / sizes, axis=1) - 1)
    assert off.max(initial=0) < 1e-3


def test_known_points_project_to_where_they_are_seen() -> None:
    scene, pose = garden_scene(2), lane_poses(1)[0]
    frame = render(scene, VGA, pose, exact=True)
    tops = [
        (s.center_m[0], s.center_m[1], s.base_m + s.height_m) for s in scene.solids if isinstance(s, Cylinder)
    ]
    uv, z = project(pose.inverse().apply(np.array(tops) - [0, 0, 0.3]), VGA)
    checked = 0
    for solid, (u, v), depth in zip([s for s in scene.solids if isinstance(s, Cylinder)], uv, z, strict=True):
        if 0 <= u < 639 and 0 <= v < 479 and frame.labels is not None:
            front = frame.depth[round(v), round(u)]
            assert frame.labels[round(v), round(u)] == OTHER.id
            assert front <= depth
            if solid.radius_m < 0.06:  # poles stand free in this garden
                assert front == pytest.approx(depth - solid.radius_m, abs=0.02)
                checked += 1
    assert checked


def test_sixteen_bit_depth_is_rounded_to_the_millimetre_and_keeps_the_sky_empty() -> None:
    pose = lane_poses(1)[0]
    exact = render(garden_scene(), SMALL, pose, exact=True)
    rounded = render(garden_scene(), SMALL, pose)
    assert rounded.depth.dtype == np.uint16
    np.testing.assert_allclose(rounded.depth * 0.001, exact.depth, atol=0.00051)
    assert rounded.labels is not None
    sky = rounded.labels == VOID_ID
    assert sky.any()
    assert not rounded.depth[sky].any()


def test_lawn_is_green_and_obstacles_are_not() -> None:
    frame = render(garden_scene(1), SMALL, lane_poses(1)[0])
    r, g, b = (frame.rgb[..., c].astype(float) for c in range(3))
    excess = (2 * g - r - b) / np.maximum(r + g + b, 1)
    assert frame.labels is not None
    assert np.quantile(excess[frame.labels == GRASS.id], 0.01) > 0.15
    assert np.quantile(excess[np.isin(frame.labels, (OTHER.id, PERSON.id))], 0.99) < 0.12


def test_nearer_things_hide_farther_ones_whatever_their_order() -> None:
    solids = garden_scene(3).solids
    pose = lane_poses(1)[0]
    one = render(Scene(solids), SMALL, pose)
    two = render(Scene(solids[::-1]), SMALL, pose)
    np.testing.assert_array_equal(one.depth, two.depth)
    np.testing.assert_array_equal(one.labels, two.labels)


def test_a_person_walks() -> None:
    person = Walker((3.0, 0.0), (0.0, 0.5))
    assert person.position_m(2_000_000_000) == pytest.approx((3.0, 1.0))
    scene = Scene(persons=(person,))
    middle = []
    for stamp_ns in (0, 2_000_000_000):
        frame = render(scene, SMALL, LEVEL, stamp_ns)
        assert frame.labels is not None
        middle.append(np.nonzero(frame.labels == PERSON.id)[1].mean())
        lower, upper = zip(*(solid.bounds() for solid in scene.at(stamp_ns)), strict=True)
        assert np.min(lower, axis=0)[2] == pytest.approx(0)
        assert np.max(upper, axis=0)[2] == pytest.approx(person.height_m, abs=0.01)
    assert middle[0] == pytest.approx(40, abs=1.5)
    assert middle[1] == pytest.approx(40 - 60 / 3, abs=1.5), "left is -u"


def brute_force(scene: Scene, spec: GridSpec, stamp_ns: int, max_height_m: float, steps: int) -> np.ndarray:
    """Classes by rays straight down from the height limit through points of each cell."""
    h, w = spec.shape
    fine = (np.arange(w * steps) + 0.5) / steps * spec.resolution_m
    x, y = np.meshgrid(fine + spec.origin_m[0], fine[: h * steps] + spec.origin_m[1])
    start = np.column_stack((x.ravel(), y.ravel(), np.full(x.size, max_height_m)))
    down = np.broadcast_to([0.0, 0.0, -1.0], start.shape)
    classes = np.full(x.size, MapClass.GRASS, np.uint8)
    for patch in scene.patches:
        classes[patch.contains(start[:, :2])] = MapClass.OBSTACLE
    for solid in scene.at(stamp_ns):  # persons come last
        t = solid.intersect(start, down)
        kind = MapClass.PERSON if solid.label is PERSON else MapClass.OBSTACLE
        classes[np.isfinite(t)] = kind  # all stand on the ground: what is hit is below the start
    return np.asarray(classes.reshape(h, steps, w, steps).max(axis=(1, 3)))


@pytest.mark.parametrize("max_height_m", [0.25, 2.0, 2.6])
def test_the_true_map_is_what_brute_force_finds(max_height_m: float) -> None:
    scene = garden_scene(5)
    spec = GridSpec(0.2, 40, 32, (2.03, -3.0))
    exact = true_map(scene, spec, 500_000_000, max_height_m).classes
    sampled = brute_force(scene, spec, 500_000_000, max_height_m, steps=8)
    assert (exact >= sampled).all(), "samples find nothing that the true map lacks"
    for iy, ix in zip(*np.nonzero(exact != sampled), strict=True):  # only grazed: look again, at every mm
        x, y = spec.origin_m[0] + 0.2 * ix, spec.origin_m[1] + 0.2 * iy
        cell = brute_force(scene, GridSpec(0.2, 1, 1, (x, y)), 500_000_000, max_height_m, steps=200)
        assert cell[0, 0] == exact[iy, ix]
    assert set(np.unique(exact)) == {MapClass.GRASS, MapClass.OBSTACLE, MapClass.PERSON}


@settings(max_examples=40, deadline=None)
@given(
    center=st.tuples(st.floats(0.2, 1.8), st.floats(0.2, 1.8)),
    size=st.tuples(st.floats(0.02, 1.0), st.floats(0.02, 1.0)),
    yaw=st.floats(-180, 180),
)
def test_a_turned_box_never_misses_a_cell_of_the_map(
    center: tuple[float, float], size: tuple[float, float], yaw: float
) -> None:
    scene = Scene((Box(center, (*size, 0.5), yaw),))
    spec = GridSpec(0.1, 20, 20)
    exact = true_map(scene, spec).classes
    assert (exact >= brute_force(scene, spec, 0, 2.0, steps=8)).all()
    # and it claims no cell whose circle is clear of the box
    ix, iy = np.meshgrid(np.arange(20), np.arange(20))
    local = spec.center_of(np.stack((ix, iy), axis=-1)) - center
    c, s = np.cos(np.deg2rad(yaw)), np.sin(np.deg2rad(yaw))
    beyond = np.abs(local @ [[c, -s], [s, c]]) - np.asarray(size) / 2
    clear = np.linalg.norm(np.maximum(beyond, 0), axis=-1) > 0.0708
    assert (exact[clear] == MapClass.GRASS).all()


def test_a_crown_above_the_limit_is_driven_under() -> None:
    crown = Scene((sphere((1.0, 1.0, 3.0), 0.9),))
    assert true_map(crown, GridSpec(0.1, 20, 20)).count(MapClass.OBSTACLE) == 0
    low = true_map(crown, GridSpec(0.01, 200, 200), max_height_m=2.4).count(MapClass.OBSTACLE)
    assert low * 1e-4 == pytest.approx(np.pi * (0.9**2 - 0.6**2), rel=0.03)


def test_every_seen_point_falls_in_a_cell_of_its_class() -> None:
    scene = garden_scene(4)
    spec = GridSpec(0.05, 300, 300, (-2.0, -7.0))
    for frame in AnalyticSource(scene, tuple(lane_poses(2, step_m=1.0)), SMALL, exact=True):
        assert frame.T_map_camera is not None
        truth = true_map(scene, spec, frame.stamp_ns)
        points = frame.T_map_camera.apply(deproject(frame.depth_m, SMALL)).reshape(-1, 3)
        labels = np.asarray(frame.labels).ravel()
        cells = spec.cell_of(np.nan_to_num(points[:, :2], nan=-99.0))
        use = spec.contains(cells) & (points[:, 2] < 1.99)
        is_hazard = truth.is_obstacle[cells[use, 1], cells[use, 0]]
        assert is_hazard[labels[use] != GRASS.id].mean() > 0.999  # float32 depth on the rim of a cell
        assert (labels[use] == GRASS.id).any()


def test_sensor_noise_grows_with_the_square_of_depth_and_keeps_the_rest() -> None:
    frame = render(Scene(), VGA, mount_pose(1.0, 90.0, parent="map"), exact=True)  # straight down: all at 1 m
    far = replace(frame, depth=frame.depth * np.float32(3))
    for shown, z in ((frame, 1.0), (far, 3.0)):
        noisy = with_sensor_noise(shown, np.random.default_rng(0), StereoNoise(0.002, 0.1, 0.0))
        valid = noisy.depth > 0
        assert valid.mean() == pytest.approx(0.9, abs=0.005)
        assert np.std(noisy.depth[valid] - z) == pytest.approx(0.002 * z * z, rel=0.03)
        assert noisy.labels is frame.labels
        assert noisy.rgb is frame.rgb


def test_flying_pixels_float_between_front_and_back() -> None:
    scene = Scene((Box((3.0, 0), (0.2, 1.0, 3.0)), Box((8.0, 0), (0.2, 40.0, 9.0))))
    frame = render(scene, SMALL, LEVEL)
    flown = with_sensor_noise(frame, np.random.default_rng(1), StereoNoise(0.0, 0.0, 0.5))
    moved = np.nonzero((flown.depth != frame.depth)[:30])
    assert len(moved[0]) > 10
    assert np.isin(moved[1], np.nonzero(np.abs(np.diff(frame.depth[0].astype(int))))[0] + [[0], [1]]).all()
    assert flown.depth[moved].min() >= 2900
    assert flown.depth[moved].max() <= 7900
    same = with_sensor_noise(frame, np.random.default_rng(1), StereoNoise(0.0, 0.0, 0.0))
    np.testing.assert_array_equal(same.depth, frame.depth)


def test_the_source_keeps_the_contract() -> None:
    frames = check_source(
        lambda: AnalyticSource(poses=tuple(lane_poses(3)), intrinsics=SMALL, noise=StereoNoise(), seed=4)
    )
    assert [f.stamp_ns for f in frames] == [0, 200_000_000, 400_000_000]
    other = AnalyticSource(poses=tuple(lane_poses(1)), intrinsics=SMALL, noise=StereoNoise(), seed=5)
    assert not np.array_equal(next(iter(other)).depth, frames[0].depth)


def test_seeds_give_different_gardens_with_a_free_start() -> None:
    assert garden_scene(7) == garden_scene(7)
    assert garden_scene(7) != garden_scene(8)
    for seed in range(30):
        near = true_map(garden_scene(seed), GridSpec(0.05, 40, 16, (0.0, -0.4)))
        assert near.count(MapClass.GRASS) == 640


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(FrameMismatchError, match="'map'"):
        render(Scene(), SMALL, mount_pose(1.0, 0.0))
    with pytest.raises(InvalidValueError, match="above the lawn"):
        render(Scene(), SMALL, mount_pose(-1.0, 0.0, parent="map"))
    with pytest.raises(FrameMismatchError, match="grid"):
        true_map(Scene(), GridSpec(0.1, 5, 5, frame_id="odom"))
    for make in (
        lambda: Box((0, 0), (1.0, 0.0, 1.0)),
        lambda: Cylinder((0, 0), -1.0, 1.0),
        lambda: sphere((0, 0, 0), float("nan")),
        lambda: Patch((0, 0), (0.0, 1.0)),
        lambda: Walker((0, 0), height_m=0.0),
        lambda: StereoNoise(dropout=1.5),
        lambda: StereoNoise(sigma_m_at_1m=-0.1),
    ):
        with pytest.raises(InvalidValueError):
            make()


def test_lane_poses_follow_the_lane() -> None:
    poses = lane_poses(3, (1.0, 2.0), heading_deg=90, step_m=0.5)
    np.testing.assert_allclose(
        [p.position_m for p in poses], [[1, 2, 0.9], [1, 2.5, 0.9], [1, 3, 0.9]], atol=1e-12
    )
    forward = poses[0].matrix[:3, 2]
    np.testing.assert_allclose(forward, [0, np.cos(np.deg2rad(20)), -np.sin(np.deg2rad(20))], atol=1e-12)


def test_frames_are_frames() -> None:
    assert all(
        isinstance(frame, Frame) for frame in AnalyticSource(poses=tuple(lane_poses(1)), intrinsics=SMALL)
    )
