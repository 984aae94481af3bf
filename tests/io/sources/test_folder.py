"""Our own folder layout: what is written comes back, and what is wrong is named."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swardmap.config import SourceConfig
from swardmap.errors import InputError, InvalidValueError, OutputError, SwardmapError
from swardmap.geometry import Intrinsics, mount_pose
from swardmap.io import open_source
from swardmap.io.sources.folder import write_folder
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.types import Frame
from tests.io.contract import check_source

K = Intrinsics(12, 9, 10.5, 11.25, 5.5, 4.0)


def frames(n: int = 4, dtype: type = np.uint16) -> list[Frame]:
    rng = np.random.default_rng(1)
    return [
        Frame(
            stamp_ns=1_700_000_000_000_000_000 + i * 33_333_333,
            intrinsics=K,
            rgb=rng.integers(0, 256, (9, 12, 3)).astype(np.uint8),
            depth=rng.integers(0, 5000, (9, 12)).astype(dtype),
            depth_unit_m=0.0005 if dtype is np.uint16 else 1.0,
            T_map_camera=mount_pose(0.9, 20.0, yaw_deg=7.0 * i, parent="map") if i != 2 else None,
            labels=rng.choice([0, 1, 2, 255], (9, 12)).astype(np.uint8),
            label_set=GRASS_OBSTACLE_PERSON,
            name=f"frame-{i}",
            tags={"scene": "0003", "illumination": "clear"},
        )
        for i in range(n)
    ]


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_what_is_written_comes_back(tmp_path: Path, dtype: type) -> None:
    written = frames(dtype=dtype)
    assert write_folder(written, tmp_path / "rec") == 4
    read = check_source(lambda: open_source(tmp_path / "rec"))
    for one, two in zip(written, read, strict=True):
        assert (one.stamp_ns, one.name, one.depth_unit_m, one.tags) == (
            two.stamp_ns, two.name, two.depth_unit_m, two.tags,
        )  # fmt: skip
        assert one.intrinsics == two.intrinsics
        assert two.label_set == GRASS_OBSTACLE_PERSON
        for a, b in ((one.rgb, two.rgb), (one.depth, two.depth), (one.labels, two.labels)):
            np.testing.assert_array_equal(a, b)
        if one.T_map_camera is None:
            assert two.T_map_camera is None
        else:
            assert two.T_map_camera is not None
            np.testing.assert_allclose(one.T_map_camera.matrix, two.T_map_camera.matrix, atol=1e-12)


def test_frames_can_be_chosen(tmp_path: Path) -> None:
    write_folder(frames(), tmp_path / "rec")
    source = open_source(tmp_path / "rec", SourceConfig(start=1, stop=4, every=2))
    assert source.frame_count == 2
    assert [f.name for f in source] == ["frame-1", "frame-3"]


def test_frames_that_miss_a_part_are_counted(tmp_path: Path) -> None:
    write_folder(frames(), tmp_path / "rec")
    (tmp_path / "rec/rgb/frame-0.png").unlink()
    (tmp_path / "rec/depth/frame-3.png").unlink()
    source = open_source(tmp_path / "rec")
    assert [f.name for f in source] == ["frame-1", "frame-2"]
    assert source.skipped == {"no colour image": 1, "no depth image": 1}


def test_the_least_a_folder_needs(tmp_path: Path) -> None:
    write_folder(frames(), tmp_path / "rec")
    (tmp_path / "rec/poses.txt").unlink()
    (tmp_path / "rec/camera.yaml").write_text("{width: 12, height: 9, fx: 10, fy: 10, cx: 5.5, cy: 4}")
    read = list(open_source(tmp_path / "rec"))
    assert [f.stamp_ns for f in read] == [0, 100_000_000, 200_000_000, 300_000_000]
    assert all(f.T_map_camera is None for f in read)
    assert read[0].depth_unit_m == 0.001


@pytest.mark.parametrize(
    ("file", "content", "match"),
    [("camera.yaml", "{width: 12}", "'height'"), ("camera.yaml", "[1, 2]", "got list"),
     ("camera.yaml", "{width: 12, height: 9, fx: 0, fy: 10, cx: 5, cy: 4}", "positive focal"),
     ("camera.yaml", "{width: 13, height: 9, fx: 9, fy: 10, cx: 5, cy: 4}", "rgb: expected"),
     ("camera.yaml", "a: [", "expected YAML"),
     ("camera.yaml", "!!python/object:os.system {}", "expected YAML"),
     ("poses.txt", "frame-0 1 nan 0 0 0 0 0 1", "line 1"),
     ("poses.txt", "frame-0 1 0 0 0 0 0 0 0", "quaternion"),
     ("poses.txt", "frame-0 1\nframe-1 0", "clock that goes back"),
     ("poses.txt", "frame-0 0", "have no line"),
     ("poses.txt", "../../etc/passwd 0", "inside"), ("poses.txt", "frame-0 1 2 3", "words"),
     ("poses.txt", "frame-0 0\nframe-0 1", "twice")],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path: Path, file: str, content: str, match: str) -> None:
    write_folder(frames(), tmp_path / "rec")
    (tmp_path / "rec" / file).write_text(content)
    with pytest.raises(InputError, match=match):
        list(open_source(tmp_path / "rec"))


def test_missing_parts_and_places(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such recording"):
        open_source(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="not a recording that swardmap knows"):
        open_source(tmp_path / "empty")
    (tmp_path / "empty/camera.yaml").write_text("{width: 12, height: 9, fx: 10, fy: 10, cx: 5, cy: 4}")
    with pytest.raises(InputError, match="expected a folder rgb/"):
        open_source(tmp_path / "empty")


def test_writing_what_does_not_belong_together(tmp_path: Path) -> None:
    one, two, *_ = frames()
    for second, match in (
        (replace(two, name=one.name), "twice"),
        (replace(two, depth_unit_m=0.1), "camera of the first"),
    ):
        with pytest.raises(InvalidValueError, match=match):
            write_folder([one, second], tmp_path / "rec")
        assert not (tmp_path / "rec").exists()
    with pytest.raises(SwardmapError):
        write_folder([replace(one, name="../evil")], tmp_path / "rec")
    with pytest.raises(InvalidValueError, match="no frame"):
        write_folder([], tmp_path / "rec")
    write_folder([one], tmp_path / "rec")
    with pytest.raises(OutputError, match="--overwrite"):
        write_folder([one], tmp_path / "rec")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)
@given(
    st.sampled_from(["camera.yaml", "poses.txt", "rgb/frame-0.png", "depth/frame-1.png"]),
    st.binary(max_size=200),
)
def test_random_bytes_are_one_error_or_frames(tmp_path: Path, file: str, content: bytes) -> None:
    folder = tmp_path / "rec"
    write_folder(frames(2), folder, overwrite=True)
    (folder / file).write_bytes(content)
    with suppress(SwardmapError):
        for frame in open_source(folder):
            assert frame.depth.shape == (frame.intrinsics.height, frame.intrinsics.width)


@pytest.mark.parametrize(("axis", "value"), [("cx", 12.0), ("cx", -0.1), ("cy", 9.0), ("cy", -3.0)])
def test_a_camera_of_another_image_size_is_refused(tmp_path: Path, axis: str, value: float) -> None:
    write_folder(frames(), tmp_path / "rec")
    file = tmp_path / "rec/camera.yaml"
    lines = [
        f"{axis}: {value}" if line.startswith(f"{axis}:") else line for line in file.read_text().split("\n")
    ]
    file.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"principal point inside the image of 12 x 9 pixels.*of this size"):
        open_source(tmp_path / "rec")
