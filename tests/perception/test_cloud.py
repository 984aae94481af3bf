"""The staged road's parts against brute force, SciPy and PCL's rules."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swardmap.errors import FrameMismatchError, InvalidValueError
from swardmap.geometry import Intrinsics, Pose, project
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.perception.cloud import (
    consistent_depth,
    crop_range,
    label_cloud,
    remove_radius_outliers,
    remove_statistical_outliers,
    voxel_downsample,
)
from swardmap.types import Frame, LabeledCloud, Segmentation

seeds = st.integers(0, 2**32 - 1)


def cloud_of(xyz: object, labels: object = None) -> LabeledCloud:
    points = np.asarray(xyz, np.float32).reshape(-1, 3)
    ids = np.zeros(len(points), np.uint8) if labels is None else np.asarray(labels, np.uint8)
    return LabeledCloud(points, ids, "camera", GRASS_OBSTACLE_PERSON)


def random_cloud(seed: int, count: int = 300) -> LabeledCloud:
    rng = np.random.default_rng(seed)
    return cloud_of(rng.uniform(-1, 1, (count, 3)), rng.integers(0, 3, count))


def test_every_point_carries_the_label_of_its_pixel() -> None:
    rng = np.random.default_rng(3)
    intrinsics = Intrinsics(32, 24, 30.0, 31.0, 15.5, 11.0)
    depth = rng.integers(0, 5000, (24, 32)).astype(np.uint16)
    depth[rng.random((24, 32)) < 0.2] = 0
    frame = Frame(7, intrinsics, np.zeros((24, 32, 3), np.uint8), depth)
    mask = rng.integers(0, 3, (24, 32)).astype(np.uint8)
    cloud = label_cloud(frame, Segmentation(mask, GRASS_OBSTACLE_PERSON))
    assert len(cloud) == np.count_nonzero(depth)
    assert cloud.stamp_ns == 7
    uv, _ = project(cloud.xyz, intrinsics)
    u, v = np.rint(uv).astype(int).T
    np.testing.assert_array_equal(cloud.labels, mask[v, u])
    np.testing.assert_allclose(cloud.xyz[:, 2], depth[v, u] / 1000, rtol=1e-6)


@settings(max_examples=40)
@given(seeds, st.integers(1, 8))
def test_consistency_is_the_rule_pixel_by_pixel(seed: int, needed: int) -> None:
    rng = np.random.default_rng(seed)
    depth = (2 + rng.choice([0, 0.05, 0.3], (7, 8)) + 0.1 * rng.random((7, 8))).astype(np.float32)
    depth[rng.random((7, 8)) < 0.2] = np.nan
    kept = consistent_depth(depth, needed, 0.02, 0.03)
    for v in range(7):
        for u in range(8):
            around = [
                depth[y, x]
                for y in range(max(0, v - 1), min(7, v + 2))
                for x in range(max(0, u - 1), min(8, u + 2))
                if (y, x) != (v, u)
            ]
            limit = depth[v, u] * np.float32(0.02) + np.float32(0.03)
            agreeing = sum(abs(depth[v, u] - n) <= limit for n in around)
            assert np.isfinite(kept[v, u]) == (agreeing >= needed)


def test_range_crop_drops_what_is_not_a_reading() -> None:
    depth = np.array([[0.1, 0.3, 8.0, 8.1, np.nan]], np.float32)
    assert np.isfinite(crop_range(depth, 0.3, 8.0)).tolist() == [[False, True, True, False, False]]


def test_voxels_follow_pcl() -> None:
    # leaf 0.5: two points of class 2 against one of class 0; then a tie between 2 and 1
    cloud = cloud_of(
        [[0.1, 0.1, 0.1], [0.3, 0.3, 0.3], [0.2, 0.2, 0.2], [0.6, 0.1, 0.1], [0.9, 0.3, 0.1], [-0.1, 0, 0]],
        [2, 0, 2, 2, 1, 0],
    )
    small = voxel_downsample(cloud, 0.5)
    np.testing.assert_allclose(small.xyz, [[-0.1, 0, 0], [0.2, 0.2, 0.2], [0.75, 0.2, 0.1]], atol=1e-6)
    assert small.labels.tolist() == [0, 2, 1]  # majority; a tie goes to the smallest id


@given(seeds, st.floats(0.05, 1.5))
def test_voxels_against_a_dictionary(seed: int, voxel_m: float) -> None:
    cloud = random_cloud(seed, 120)
    cells: dict[tuple[int, ...], list[int]] = {}
    for i, p in enumerate(cloud.xyz):
        key = tuple(int(c) for c in np.floor(p * np.float32(1 / voxel_m)))
        cells.setdefault(key, []).append(i)
    small = voxel_downsample(cloud, voxel_m)
    order = sorted(cells, key=lambda key: key[::-1])  # z slowest, x fastest
    assert len(small) == len(cells)
    for row, key in enumerate(order):
        members = cells[key]
        np.testing.assert_allclose(small.xyz[row], cloud.xyz[members].mean(axis=0), atol=1e-5)
        votes = np.bincount(cloud.labels[members], minlength=3)
        assert small.labels[row] == votes.argmax()


def test_voxels_need_a_size() -> None:
    with pytest.raises(InvalidValueError, match="positive edge"):
        voxel_downsample(random_cloud(0), 0.0)
    with pytest.raises(InvalidValueError, match="too fine"):
        voxel_downsample(cloud_of([[0, 0, 0], [1e6, 1e6, 1e6]]), 1e-3)
    assert len(voxel_downsample(cloud_of([]), 0.1)) == 0


@given(seeds)
def test_statistical_outliers_by_brute_force(seed: int) -> None:
    cloud = random_cloud(seed, 60)
    distances = np.linalg.norm(cloud.xyz[:, None].astype(float) - cloud.xyz[None].astype(float), axis=-1)
    mean = np.sort(distances, axis=1)[:, 1:9].mean(axis=1)  # without the point itself
    limit = mean.mean() + 1.0 * mean.std(ddof=1)
    if np.abs(mean - limit).min() < 1e-9:
        return
    kept = remove_statistical_outliers(cloud, 8, 1.0)
    np.testing.assert_array_equal(kept.xyz, cloud.xyz[mean <= limit])


@given(seeds)
def test_radius_outliers_by_brute_force(seed: int) -> None:
    cloud = random_cloud(seed, 80)
    distances = np.linalg.norm(cloud.xyz[:, None].astype(float) - cloud.xyz[None].astype(float), axis=-1)
    if np.abs(distances - 0.4).min() < 1e-9:
        return
    others = (distances <= 0.4).sum(axis=1) - 1
    kept = remove_radius_outliers(cloud, 0.4, 5)
    np.testing.assert_array_equal(kept.xyz, cloud.xyz[others >= 5])


def test_outlier_removal_of_almost_nothing() -> None:
    for count in (0, 1):
        cloud = random_cloud(0, count)
        assert len(remove_statistical_outliers(cloud, 20, 2.0)) == count
    assert len(remove_radius_outliers(random_cloud(0, 0), 0.1, 1)) == 0


def test_one_index_slices_every_field() -> None:
    cloud = random_cloud(1)
    part = cloud[cloud.labels == 2]
    assert len(part) == len(part.labels) == int((cloud.labels == 2).sum())
    assert part.frame_id == cloud.frame_id


def test_cloud_moves_only_with_a_pose_of_its_frame() -> None:
    cloud = random_cloud(2)
    with pytest.raises(FrameMismatchError, match="'camera'"):
        cloud.transformed(Pose.identity("map", "base"))
    assert cloud.transformed(Pose.identity("map", "camera")).frame_id == "map"


def test_pcls_golden_numbers(data_dir: Path) -> None:
    # test/bun0.pcd and the expectations of test/filters/test_filters.cpp in the PCL repository
    file = data_dir / "pcl" / "bun0.pcd"
    if not file.exists():
        pytest.skip(f"{file} is not there; it is test/bun0.pcd of the PCL repository")
    rows = file.read_text().splitlines()
    bunny = cloud_of(np.loadtxt(rows[rows.index("DATA ascii") + 1 :])[:, :3])
    small = voxel_downsample(bunny, 0.02)
    assert len(small) == 103
    slice_ = voxel_downsample(bunny[(bunny.xyz[:, 2] >= 0.05) & (bunny.xyz[:, 2] <= 0.1)], 0.02)
    assert len(slice_) == 14
    np.testing.assert_allclose(slice_.xyz[0], [-0.026125, 0.039788, 0.052827], atol=1e-4)
    np.testing.assert_allclose(slice_.xyz[13], [-0.073202, 0.1296, 0.051333], atol=1e-4)
    assert len(remove_statistical_outliers(bunny, 50, 1.0)) == 352
    assert len(remove_radius_outliers(bunny, 0.02, 14)) == 307


def test_flying_pixels_are_removed_and_the_sheets_stay() -> None:
    depth = np.full((20, 20), 2.0, np.float32)
    depth[:, 10:] = 5.0
    depth[:, 10] = 3.4  # a column of flying pixels between the two
    kept = consistent_depth(depth, 3, 0.03, 0.02)
    assert np.isnan(kept[:, 10]).all()
    assert np.isfinite(np.delete(kept, 10, axis=1)).all()
