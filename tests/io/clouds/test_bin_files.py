"""Bare floats: how many a point has, and where the labels lie."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.clouds.cloud_files import read_points

RNG = np.random.default_rng(0)
XYZ = RNG.uniform(-20, 20, (40, 3)).astype(np.float32)
FOUR = np.hstack([XYZ, RNG.uniform(0, 1, (40, 1))]).astype("<f4")
FIVE = np.hstack([XYZ, RNG.uniform(0, 255, (40, 1)), RNG.integers(0, 32, (40, 1))]).astype("<f4")
LABELS = RNG.integers(0, 5, 40).astype("<u4")


def written(file: Path, table: NDArray[np.generic]) -> Path:
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(table.tobytes())
    return file


@pytest.mark.parametrize("table", [FOUR, FIVE])  # 640 and 800 bytes: both may be points of 16 and of 20
def test_points_of_four_and_five_numbers_are_told_apart(table: NDArray[np.float32], tmp_path: Path) -> None:
    points = read_points(written(tmp_path / "a.pcd.bin", table))
    np.testing.assert_array_equal(points.xyz, XYZ)


def test_the_number_of_labels_settles_it(tmp_path: Path) -> None:
    zeros = np.zeros((40, 4), "<f4")  # may be 32 points of five
    file = written(tmp_path / "a.bin", zeros)
    with pytest.raises(InputError, match=r"4 or 5 numbers.*--point-floats"):
        read_points(file)
    assert len(read_points(file, 4).xyz) == 40
    assert len(read_points(file, 5).xyz) == 32
    written(tmp_path / "a.label", LABELS)
    points = read_points(file)
    assert points.ids is not None
    np.testing.assert_array_equal(points.ids, LABELS)
    with pytest.raises(InputError, match="4 or 5 numbers a point, got 3"):
        read_points(file, 3)
    with pytest.raises(InputError, match="truncated"):
        read_points(written(tmp_path / "b.bin", FOUR[:3].ravel()[:-1]))


def test_the_labels_of_rellis_lie_in_a_folder_beside(tmp_path: Path) -> None:
    file = written(tmp_path / "os1_cloud_node_kitti_bin/000000.bin", FOUR)
    assert read_points(file).ids is None
    written(tmp_path / "os1_cloud_node_semantickitti_label_id/000000.label", LABELS)
    points = read_points(file)
    assert points.ids is not None
    np.testing.assert_array_equal(points.ids, LABELS)
    written(tmp_path / "other_labels/000000.label", LABELS)
    with pytest.raises(InputError, match=r"other_labels.*copy the right one beside it"):
        read_points(file)
    written(tmp_path / "os1_cloud_node_kitti_bin/000000.label", LABELS + 1)
    points = read_points(file)
    assert points.ids is not None
    np.testing.assert_array_equal(points.ids, LABELS + 1)
