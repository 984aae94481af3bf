"""Both backends agree to the last digit, every pixel is counted once, and doubt frees nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.config import CloudConfig, Config, GeometryConfig, GridConfig, SegmenterConfig, WatchdogConfig
from swardmap.errors import ConfigError
from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.grid import GridSpec
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.perception import compiled
from swardmap.perception.cloud import consistent_depth
from swardmap.perception.compiled import consistent_pixels
from swardmap.perception.ground_surface import GroundPlane, fit_ground
from swardmap.perception.observation import Observation
from swardmap.pipeline import observe
from swardmap.types import Frame, Segmentation

seeds = st.integers(0, 2**32 - 1)


def random_depth(
    rng: np.random.Generator, intrinsics: Intrinsics, pose: Pose
) -> NDArray[np.uint16] | NDArray[np.float32]:
    """A lawn with jumps, holes and noise, or sheets that are no lawn: some pixels consistent, some not."""
    shape = intrinsics.height, intrinsics.width
    ray_x, ray_y = intrinsics.ray_tables()
    R, height = pose.matrix[:3, :3], pose.matrix[2, 3]
    falls = ray_x[None, :] * R[2, 0] + ray_y[:, None] * R[2, 1] + R[2, 2]
    with np.errstate(divide="ignore"):
        lawn = np.where(falls < 0, -height / falls, 0)
    sheet = rng.uniform(0.2, 10) + rng.uniform(-2, 2) * np.linspace(0, 1, shape[0])[:, None] + np.zeros(shape)
    depth = lawn if rng.random() < 0.6 else sheet
    depth = depth + rng.choice([0.0, -0.4, 0.5, 3.0], shape, p=[0.8, 0.08, 0.08, 0.04])
    depth += rng.normal(0, rng.choice([0, 0.01, 0.1]), shape)
    if rng.random() < 0.5:
        millimetres: NDArray[np.uint16] = np.clip(depth * 1000, 0, 65535).astype(np.uint16)
        millimetres[rng.random(shape) < 0.1] = 0
        return millimetres
    metres: NDArray[np.float32] = depth.astype(np.float32)
    for bad in (np.nan, np.inf, -np.inf, 0.0, -1.0):
        metres[rng.random(shape) < 0.03] = bad
    return metres


def random_frame(rng: np.random.Generator) -> tuple[Frame, Pose]:
    height, width = int(rng.integers(1, 50)), int(rng.integers(1, 50))
    intrinsics = Intrinsics(
        width, height, rng.uniform(5, 80), rng.uniform(5, 80), rng.uniform(-3, width), rng.uniform(0, height)
    )
    mount = mount_pose(rng.uniform(0, 2), rng.uniform(-20, 90), rng.uniform(-30, 30), rng.uniform(-180, 180))
    matrix = mount.matrix.copy()
    matrix[:2, 3] += rng.uniform(-1, 1, 2) * 10.0 ** rng.integers(0, 7)  # up to UTM-sized coordinates
    pose = Pose("map", "camera", matrix)
    unit = float(rng.choice([0.001, 0.0001, 1 / 256]))
    rgb = np.zeros((height, width, 3), np.uint8)
    return Frame(7, intrinsics, rgb, random_depth(rng, intrinsics, pose), unit), pose


def random_mask(rng: np.random.Generator) -> Segmentation:
    shape = int(rng.integers(1, 30)), int(rng.integers(1, 30))
    labels = rng.choice([0, 1, 1, 1, 2, 7, 255], shape).astype(np.uint8)
    confidence = rng.random(shape).astype(np.float32) if rng.random() < 0.7 else None
    hazard = rng.integers(0, 256, shape).astype(np.uint8) if rng.random() < 0.5 else None
    if confidence is not None:
        confidence[rng.random(shape) < 0.05] = np.nan
    unfamiliar = float(rng.choice([0.5, 2.0])) if rng.random() < 0.3 else None
    return Segmentation(labels, GRASS_OBSTACLE_PERSON, confidence, hazard, unfamiliar)


def random_view(rng: np.random.Generator, pose: Pose) -> GridSpec:
    corner = pose.position_m[:2] - rng.uniform(0, 8, 2)
    resolution_m = float(rng.choice([0.05, 0.1, 0.37]))
    return GridSpec(
        resolution_m, int(rng.integers(1, 150)), int(rng.integers(1, 150)), (corner[0], corner[1])
    )


def random_config(rng: np.random.Generator) -> Config:
    cloud = CloudConfig(
        min_range_m=float(rng.choice([0.0, 0.3])),
        max_range_m=float(rng.choice([4.0, 8.0])),
        min_height_m=float(rng.choice([-1.0, -0.3])),
        consistent_neighbours=int(rng.integers(0, 9)),
    )
    enabled = bool(rng.random() < 0.8)
    geometry = GeometryConfig(
        enabled=enabled,
        semantics=not enabled or bool(rng.random() < 0.8),
        min_points=int(rng.integers(1, 6)),
        doubt_above=float(rng.random()),
        ground_block_m=float(rng.choice([0.1, 0.4, 2.0])),
        max_bend_deg=float(rng.choice([0.0, 12.0, 30.0])),
        max_slope_deg=float(rng.choice([10.0, 30.0, 60.0])),
    )
    k_mark, k_clear = (int(k) for k in rng.integers(1, 4, 2))
    grid = GridConfig(
        min_points=k_mark,
        min_grass_points=k_clear,
        clear_together=bool(rng.random() < 0.8),
        clear_below=float(rng.random()),
    )
    sure = SegmenterConfig(min_confidence=float(rng.choice([0.0, 0.5])))
    watchdog = WatchdogConfig(unfamiliar=1.0 if rng.random() < 0.8 else None)
    return Config(cloud=cloud, geometry=geometry, grid=grid, segmenter=sure, watchdog=watchdog)


def earlier_plane(rng: np.random.Generator, pose: Pose) -> GroundPlane | None:
    if rng.random() < 0.5:
        return None
    x, y, z = (pose.position_m - (0, 0, rng.uniform(-0.2, 2))).tolist()
    return GroundPlane((rng.normal(0, 0.1), rng.normal(0, 0.1)), (x, y, z))


@settings(max_examples=150, deadline=None)
@given(seeds)
def test_backends_agree_on_random_frames(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frame, pose = random_frame(rng)
    mask, spec, config, earlier = (
        random_mask(rng), random_view(rng, pose), random_config(rng), earlier_plane(rng, pose),
    )  # fmt: skip
    fast, plain = (
        observe(frame, mask, pose, spec, replace(config, backend=backend), earlier)
        for backend in ("compiled", "plain")
    )
    for name in ("classes", "points", "semantic", "ground_m", "height_row"):
        np.testing.assert_array_equal(getattr(fast, name), getattr(plain, name), err_msg=name)
    assert (fast.ground is None) == (plain.ground is None)
    if fast.ground is not None and plain.ground is not None:
        for name in ("plane", "offset_m", "floor_m"):
            np.testing.assert_array_equal(getattr(fast.ground, name), getattr(plain.ground, name), name)
    assert (fast.geometry is None) == (plain.geometry is None)
    if fast.geometry is not None and plain.geometry is not None:
        for name in ("marks", "holes", "doubted"):
            np.testing.assert_array_equal(getattr(fast.geometry, name), getattr(plain.geometry, name))
    assert fast.counts == plain.counts


@settings(max_examples=150, deadline=None)
@given(seeds)
def test_backends_fit_the_same_ground_to_whatever_was_seen(seed: int) -> None:
    """Few heights, so that many cells of a block are equally low; holes, steps and far-off heights."""
    rng = np.random.default_rng(seed)
    spec = GridSpec(float(rng.choice([0.05, 0.1, 0.37])), int(rng.integers(1, 70)), int(rng.integers(1, 70)))
    n = spec.width * spec.height
    points = rng.integers(0, 4, n) * (rng.random(n) < rng.random())
    low = rng.choice([0, 100, -300, 5000], n) + rng.integers(0, 1 + int(rng.choice([1, 20, 3000])), n)
    low += int(rng.choice([0, -30_000, 10_000_000]))
    sums = np.stack([low * points + rng.integers(0, 500, n) * points, points, low], axis=1)
    sums[points == 0] = 0, 0, 2**31 - 1
    config = random_config(rng).geometry
    fast, plain = compiled.fit_ground(sums, spec, config), fit_ground(sums, spec, config)
    assert (fast is None) == (plain is None)
    if fast is not None and plain is not None:
        for name in ("plane", "offset_m", "floor_m"):
            np.testing.assert_array_equal(getattr(fast, name), getattr(plain, name), name)


@settings(max_examples=60, deadline=None)
@given(seeds)
def test_every_pixel_is_accounted_for_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frame, pose = random_frame(rng)
    for cloud, backend in (
        (CloudConfig(), "compiled"),
        (CloudConfig(voxel_m=0.05, outliers="statistical", outlier_neighbours=5), "plain"),
        (CloudConfig(voxel_m=0.05, outliers="radius", outlier_neighbours=2), "plain"),
    ):
        config = Config(cloud=cloud, backend=backend)
        n = observe(frame, random_mask(rng), pose, random_view(rng, pose), config).counts
        parts = (n.no_reading, n.out_of_range, n.inconsistent, n.void, n.out_of_height)
        rest = (n.merged, n.outside_grid, n.used)
        assert sum(parts) + sum(rest) == n.pixels == frame.depth.size
        assert min(*parts, *rest) >= 0


STRICTER = {
    "clear_below": lambda c, u: replace(c, grid=replace(c.grid, clear_below=c.grid.clear_below * u)),
    "min_grass_points": lambda c, u: replace(
        c, grid=replace(c.grid, min_grass_points=c.grid.min_grass_points + int(4 * u))
    ),
    "clear_together": lambda c, u: replace(c, grid=replace(c.grid, clear_together=False)),
    "min_confidence": lambda c, u: replace(
        c, segmenter=replace(c.segmenter, min_confidence=max(c.segmenter.min_confidence, u))
    ),
    "watchdog.unfamiliar": lambda c, u: replace(
        c, watchdog=replace(c.watchdog, unfamiliar=(c.watchdog.unfamiliar or 0) * u)
    ),
    "min_points": lambda c, u: replace(c, grid=replace(c.grid, min_points=1)),
    "geometry.enabled": lambda c, u: replace(c, geometry=replace(c.geometry, enabled=True)),
    "geometry.min_points": lambda c, u: replace(c, geometry=replace(c.geometry, min_points=1)),
    "geometry.min_height_m": lambda c, u: replace(
        c, geometry=replace(c.geometry, min_height_m=max(0.01, c.geometry.min_height_m * u))
    ),
    "geometry.doubt_above": lambda c, u: replace(
        c, geometry=replace(c.geometry, doubt_above=c.geometry.doubt_above * u)
    ),
    "geometry.doubt_height_m": lambda c, u: replace(
        c, geometry=replace(c.geometry, doubt_height_m=max(0.01, c.geometry.doubt_height_m * u))
    ),
    "geometry.semantics": lambda c, u: replace(
        c, geometry=replace(c.geometry, enabled=True, semantics=False)
    ),
}
"""Every setting that makes the system more careful."""


def taken_for_grass(seen: Observation, grid: GridConfig) -> NDArray[np.bool_]:
    """(height, width) bool: what the map of log-odds takes for lawn."""
    grass, hazard = seen.points[..., MapClass.GRASS], seen.points[..., MapClass.OBSTACLE :].sum(axis=-1)
    return np.asarray((grass >= grid.min_grass_points) & (hazard < grid.min_points))


@settings(max_examples=200, deadline=None)
@given(seeds, st.sampled_from(sorted(STRICTER)), st.floats(0, 1))
def test_no_stricter_setting_ever_turns_a_cell_free(seed: int, name: str, share: float) -> None:
    rng = np.random.default_rng(seed)
    frame, pose = random_frame(rng)
    mask, spec, config, earlier = (
        random_mask(rng), random_view(rng, pose), random_config(rng), earlier_plane(rng, pose),
    )  # fmt: skip
    careful = STRICTER[name](config, share)
    before, after = (observe(frame, mask, pose, spec, c, earlier) for c in (config, careful))
    assert not ((after.classes == MapClass.GRASS) & (before.classes != MapClass.GRASS)).any()
    lawn = [taken_for_grass(o, c.grid) for o, c in ((before, config), (after, careful))]
    assert not (lawn[1] & ~lawn[0]).any()  # what the map of log-odds takes for grass


@settings(max_examples=100, deadline=None)
@given(seeds)
def test_more_doubt_never_frees_a_cell_and_never_takes_a_mark(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frame, pose = random_frame(rng)
    mask, spec, config = random_mask(rng), random_view(rng, pose), random_config(rng)
    mask = replace(mask, hazard=mask.hazard_255)
    assert mask.hazard is not None
    more = replace(
        mask, hazard=np.maximum(mask.hazard, rng.integers(0, 256, mask.hazard.shape).astype(np.uint8))
    )
    before, after = (observe(frame, m, pose, spec, config) for m in (mask, more))
    assert not ((after.classes == MapClass.GRASS) & (before.classes != MapClass.GRASS)).any()
    assert not ((after.classes < MapClass.OBSTACLE) & (before.classes >= MapClass.OBSTACLE)).any()


@pytest.mark.parametrize("backend", ["compiled", "plain"])
def test_an_unfamiliar_image_clears_nothing_and_keeps_its_marks(
    flat_lawn: tuple[Frame, Segmentation], backend: str
) -> None:
    frame, segmentation = flat_lawn
    labels = segmentation.labels.copy()
    labels[60:90, 60:90] = 0
    assert frame.T_map_camera is not None
    spec = GridSpec(0.1, 80, 80, (0.0, -4.0))

    def seen(unfamiliar: float, limit: float | None = 1.0, clear_below: float = 1.0) -> NDArray[np.uint8]:
        mask = replace(segmentation, labels=labels, unfamiliar=unfamiliar)
        grid, watchdog = GridConfig(clear_below=clear_below), WatchdogConfig(unfamiliar=limit)
        config = Config(backend=backend, grid=grid, watchdog=watchdog)
        assert frame.T_map_camera is not None
        return observe(frame, mask, frame.T_map_camera, spec, config).classes

    for clear_below in (0.1, 1.0):
        known, strange = seen(0.9, clear_below=clear_below), seen(1.1, clear_below=clear_below)
        assert np.count_nonzero(known == MapClass.GRASS) > 500
        assert not (strange == MapClass.GRASS).any()
        np.testing.assert_array_equal(strange >= MapClass.OBSTACLE, known >= MapClass.OBSTACLE)
        assert np.count_nonzero(strange >= MapClass.OBSTACLE) > 20
        np.testing.assert_array_equal(seen(1.1, None, clear_below), known)  # switched off


def lawn_seen(flat_lawn: tuple[Frame, Segmentation], **changes: object) -> Observation:
    frame, segmentation = flat_lawn
    assert frame.T_map_camera is not None
    spec = GridSpec(0.1, 80, 80, (0.0, -4.0))
    frame = replace(frame, **changes)  # type: ignore[arg-type]
    return observe(frame, segmentation, frame.T_map_camera or Pose.identity("map", "camera"), spec, Config())


def test_flat_lawn_is_grass_and_nothing_else(flat_lawn: tuple[Frame, Segmentation]) -> None:
    seen = lawn_seen(flat_lawn)
    assert np.count_nonzero(seen.classes == MapClass.GRASS) > 500
    assert not seen.points[..., MapClass.OBSTACLE :].any()
    assert seen.counts.out_of_height == 0
    assert seen.camera_height_m == pytest.approx(1.0, abs=0.01)


def test_invalid_readings_clear_nothing(flat_lawn: tuple[Frame, Segmentation]) -> None:
    seen = lawn_seen(flat_lawn, depth=np.full_like(flat_lawn[0].depth, np.nan))
    assert not seen.points.any()
    assert not seen.classes.any()
    assert seen.ground is None
    assert seen.counts.no_reading == seen.counts.pixels


@pytest.mark.parametrize("backend", ["compiled", "plain"])
def test_a_wire_that_the_filter_drops_is_no_lawn(flat_lawn: tuple[Frame, Segmentation], backend: str) -> None:
    """One pixel wide before the lawn: too few neighbours agree with it, and it marks nothing."""
    frame, segmentation = flat_lawn
    assert frame.T_map_camera is not None
    _, ray_y = frame.intrinsics.ray_tables()
    at_2m = 2.05 / (np.cos(np.deg2rad(30)) - ray_y * np.sin(np.deg2rad(30)))
    depth = frame.depth.copy()
    depth[:, 80] = np.fmin(np.where(depth[:, 80] > 0, depth[:, 80], np.inf), at_2m)
    spec, config = GridSpec(0.1, 80, 80, (0.0, -4.0)), Config(backend=backend)
    before, after = (
        observe(replace(frame, depth=d), segmentation, frame.T_map_camera, spec, config).classes
        for d in (frame.depth, depth)
    )
    wire = spec.cell_of(np.array([[2.05, -0.05]]))[0]
    assert before[wire[1], wire[0]] == MapClass.GRASS
    assert after[wire[1], wire[0]] == MapClass.UNKNOWN
    assert np.count_nonzero(before == MapClass.GRASS) - np.count_nonzero(after == MapClass.GRASS) < 12
    off = replace(config, geometry=replace(config.geometry, enabled=False))
    level = observe(replace(frame, depth=depth), segmentation, frame.T_map_camera, spec, off).classes
    assert level[wire[1], wire[0]] == MapClass.GRASS  # what depth says of heights was switched off


def test_ids_that_are_not_declared_are_never_free(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, segmentation = flat_lawn
    strange = replace(segmentation, labels=np.full_like(segmentation.labels, 99))
    seen = lawn_seen((frame, strange))
    assert not seen.points.any()
    assert seen.counts.void > 0


def test_the_compiled_backend_refuses_what_it_would_leave_out(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, segmentation = flat_lawn
    assert frame.T_map_camera is not None
    config = Config(cloud=CloudConfig(voxel_m=0.05))
    with pytest.raises(ConfigError, match="set backend to 'plain'"):
        observe(frame, segmentation, frame.T_map_camera, GridSpec(0.1, 10, 10), config)


def test_a_cell_is_cleared_by_the_mean_of_its_doubt(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, segmentation = flat_lawn
    shape = segmentation.labels.shape
    for doubt, free in ((10, True), (12, True), (13, False), (120, False)):
        told = replace(segmentation, hazard=np.full(shape, doubt, np.uint8))
        seen = lawn_seen((frame, told))
        assert bool((seen.classes == MapClass.GRASS).any()) is free, doubt


def test_doubt_about_grass_does_not_take_obstacles_away(flat_lawn: tuple[Frame, Segmentation]) -> None:
    """`min_confidence` once made doubtful obstacles void, and the grass beside them cleared the cell."""
    frame, segmentation = flat_lawn
    labels = segmentation.labels.copy()
    labels[60:90, 60:90] = 0
    confidence = np.full(labels.shape, 0.6, np.float32)
    mask = Segmentation(labels, GRASS_OBSTACLE_PERSON, confidence)
    assert frame.T_map_camera is not None
    spec = GridSpec(0.1, 80, 80, (0.0, -4.0))
    marks = []
    for threshold in (0.0, 0.5, 0.7, 1.0):
        config = Config(segmenter=SegmenterConfig(min_confidence=threshold))
        marks.append(observe(frame, mask, frame.T_map_camera, spec, config).classes >= MapClass.OBSTACLE)
    assert marks[0].sum() > 20
    assert all(np.array_equal(marks[0], later) for later in marks)


@pytest.mark.parametrize("backend", ["compiled", "plain"])
def test_depth_that_a_source_has_filtered_is_not_filtered_again(
    flat_lawn: tuple[Frame, Segmentation], backend: str
) -> None:
    frame, segmentation = flat_lawn
    assert frame.T_map_camera is not None
    sparse = np.full_like(frame.depth, np.nan)
    sparse[::3, ::3] = frame.depth[::3, ::3]  # no pixel has a neighbour
    config = Config(backend=backend)
    spec = GridSpec(0.1, 80, 80, (0.0, -4.0))
    raw, filtered = (
        observe(
            replace(frame, depth=sparse, depth_filtered=told), segmentation, frame.T_map_camera, spec, config
        )
        for told in (False, True)
    )
    assert raw.counts.used == 0
    assert filtered.counts.inconsistent == 0
    assert filtered.counts.used > 500


@settings(max_examples=60, deadline=None)
@given(seeds)
def test_the_compiled_filter_keeps_what_the_plain_one_keeps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frame, _ = random_frame(rng)
    config = CloudConfig(consistent_neighbours=int(rng.integers(0, 9)))
    plain = consistent_depth(
        frame.depth_m, config.consistent_neighbours, config.consistency_relative, config.consistency_m
    )
    np.testing.assert_array_equal(consistent_pixels(frame.depth_m, config), np.isfinite(plain))
