"""The plain and the compiled backend must agree cell for cell and count for count, whatever comes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.config import CloudConfig
from swardmap.errors import ConfigError
from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.grid import GridSpec
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.perception.cloud import consistent_depth
from swardmap.perception.counting import count_compiled, count_plain
from swardmap.types import Frame, Segmentation

seeds = st.integers(0, 2**32 - 1)


def random_depth(
    rng: np.random.Generator, height: int, width: int, dtype: str
) -> NDArray[np.uint16] | NDArray[np.float32]:
    """Smooth sheets with jumps, holes and noise: some pixels consistent, some not."""
    depth = rng.uniform(0.2, 10) + rng.uniform(-2, 2) * np.linspace(0, 1, height)[:, None]
    depth = depth + rng.choice([0.0, 0.5, 3.0], (height, width), p=[0.8, 0.1, 0.1])
    depth += rng.normal(0, rng.choice([0, 0.01, 0.1]), (height, width))
    if dtype == "uint16":
        millimetres: NDArray[np.uint16] = np.clip(depth * 1000, 0, 65535).astype(np.uint16)
        millimetres[rng.random((height, width)) < 0.1] = 0
        return millimetres
    metres: NDArray[np.float32] = depth.astype(np.float32)
    for bad in (np.nan, np.inf, -np.inf, 0.0, -1.0):
        metres[rng.random((height, width)) < 0.03] = bad
    return metres


def random_pose(rng: np.random.Generator) -> Pose:
    mount = mount_pose(rng.uniform(0, 2), rng.uniform(-20, 90), rng.uniform(-30, 30), rng.uniform(-180, 180))
    far = 10.0 ** rng.integers(0, 7)  # up to UTM-sized coordinates
    matrix = mount.matrix.copy()
    matrix[:2, 3] += rng.uniform(-far, far, 2)
    return Pose("map", "camera", matrix)


@settings(max_examples=120, deadline=None)
@given(seeds, st.sampled_from(["uint16", "float32"]))
def test_backends_agree_on_random_frames(seed: int, dtype: str) -> None:
    rng = np.random.default_rng(seed)
    height, width = int(rng.integers(1, 40)), int(rng.integers(1, 40))
    intrinsics = Intrinsics(
        width, height, rng.uniform(5, 60), rng.uniform(5, 60), rng.uniform(-3, width), rng.uniform(0, height)
    )
    pose = random_pose(rng)
    frame = Frame(
        0,
        intrinsics,
        np.zeros((height, width, 3), np.uint8),
        random_depth(rng, height, width, dtype),
        depth_unit_m=float(rng.choice([0.001, 0.0001, 1 / 256])),
    )
    mask = rng.choice([0, 1, 2, 7, 255], (rng.integers(1, 30), rng.integers(1, 30))).astype(np.uint8)
    segmentation = Segmentation(mask, GRASS_OBSTACLE_PERSON)
    resolution = float(rng.choice([0.05, 0.1, 0.37]))
    corner = pose.position_m[:2] - rng.uniform(0, 10, 2)
    spec = GridSpec(resolution, int(rng.integers(1, 150)), int(rng.integers(1, 150)), (corner[0], corner[1]))
    config = CloudConfig(
        min_range_m=float(rng.choice([0.0, 0.3])),
        max_range_m=float(rng.choice([4.0, 8.0])),
        min_height_m=-1.0,
        consistent_neighbours=int(rng.integers(0, 9)),
    )
    lawn = rng.normal(0, 1, 4).astype(np.float32) if rng.random() < 0.5 else None
    plain, plain_counts = count_plain(frame, segmentation, pose, spec, config, lawn)
    compiled, compiled_counts = count_compiled(frame, segmentation, pose, spec, config, lawn)
    np.testing.assert_array_equal(plain, compiled)
    assert plain_counts == compiled_counts


@settings(max_examples=60, deadline=None)
@given(seeds)
def test_every_pixel_is_accounted_for_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    intrinsics = Intrinsics(24, 16, 20.0, 20.0, 11.5, 7.5)
    frame = Frame(0, intrinsics, np.zeros((16, 24, 3), np.uint8), random_depth(rng, 16, 24, "uint16"))
    segmentation = Segmentation(rng.choice([0, 1, 2, 255], (16, 24)).astype(np.uint8), GRASS_OBSTACLE_PERSON)
    spec = GridSpec(0.1, 40, 40, (0.0, -2.0))
    for config, count in (
        (CloudConfig(), count_compiled),
        (CloudConfig(voxel_m=0.05, outliers="statistical", outlier_neighbours=5), count_plain),
        (CloudConfig(voxel_m=0.05, outliers="radius", outlier_neighbours=2), count_plain),
    ):
        _, n = count(frame, segmentation, random_pose(rng), spec, config)
        parts = (n.no_reading, n.out_of_range, n.inconsistent, n.void, n.out_of_height)
        rest = (n.merged, n.outside_grid, n.used)
        assert sum(parts) + sum(rest) == n.pixels == frame.depth.size
        assert min(*parts, *rest) >= 0


def test_flat_lawn_is_grass_and_nothing_else(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, segmentation = flat_lawn
    assert frame.T_map_camera is not None
    spec = GridSpec(0.1, 80, 80, (0.0, -4.0))
    points, counts = count_compiled(frame, segmentation, frame.T_map_camera, spec, CloudConfig())
    assert np.count_nonzero(points[..., MapClass.GRASS]) > 500
    assert not points[..., MapClass.OBSTACLE :].any()
    assert counts.out_of_height == 0


def test_invalid_readings_clear_nothing(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, segmentation = flat_lawn
    assert frame.T_map_camera is not None
    blind = replace(frame, depth=np.full_like(frame.depth, np.nan))
    spec = GridSpec(0.1, 80, 80, (0.0, -4.0))
    for count in (count_plain, count_compiled):
        points, counts = count(blind, segmentation, frame.T_map_camera, spec, CloudConfig())
        assert not points.any()
        assert counts.no_reading == counts.pixels


def test_ids_that_are_not_declared_are_never_free(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, segmentation = flat_lawn
    assert frame.T_map_camera is not None
    strange = replace(segmentation, labels=np.full_like(segmentation.labels, 99))
    spec = GridSpec(0.1, 80, 80, (0.0, -4.0))
    points, counts = count_compiled(frame, strange, frame.T_map_camera, spec, CloudConfig())
    assert not points.any()
    assert counts.void > 0


def test_flying_pixels_are_removed_and_the_sheets_stay() -> None:
    depth = np.full((20, 20), 2.0, np.float32)
    depth[:, 10:] = 5.0
    depth[:, 10] = 3.4  # a column of flying pixels between the two
    kept = consistent_depth(depth, 3, 0.03, 0.02)
    assert np.isnan(kept[:, 10]).all()
    assert np.isfinite(np.delete(kept, 10, axis=1)).all()


def test_the_compiled_backend_refuses_what_it_would_leave_out(flat_lawn: tuple[Frame, Segmentation]) -> None:
    frame, segmentation = flat_lawn
    assert frame.T_map_camera is not None
    spec = GridSpec(0.1, 10, 10)
    with pytest.raises(ConfigError, match="set backend to 'plain'"):
        count_compiled(frame, segmentation, frame.T_map_camera, spec, CloudConfig(voxel_m=0.05))
