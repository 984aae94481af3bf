"""ORFD sequences: names, calibration, units, missing parts; made here, and the real one."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import Intrinsics, mount_pose
from swardmap.io import open_source
from swardmap.io.sources import orfd
from swardmap.io.sources.orfd import parse_calibration
from swardmap.perception.ground_plane import estimate_mount
from swardmap.synth.analytic import Scene, render
from tests.io.contract import check_source

CAMERA = Intrinsics(160, 90, 186.0, 184.0, 78.0, 47.0)
CALIBRATION = "cam_K: 186.0 0.0 78.0 0.0 184.0 47.0 0.0 0.0 1.0 \ncam_RT: 1 0 0 0\nlidar_T: 0 0 0 \n"
STAMPS_MS = (1623721491895, 1623721491991, 1623721492091)
NAMES = tuple(map(str, STAMPS_MS))


def write_sequence(folder: Path, color: str = "image_data", depth: str = "dense_depth") -> None:
    """A road seen from 2 m above it, as ORFD would write it."""
    for part in (color, depth, "calib"):
        (folder / part).mkdir(parents=True)
    frame = render(Scene(), CAMERA, mount_pose(2.0, 8.0, parent="map"), exact=True, max_depth_m=100.0)
    for name in NAMES:
        cv2.imwrite(str(folder / color / f"{name}.png"), frame.rgb[..., ::-1])
        units = np.rint(frame.depth * 256).astype(np.uint16)
        cv2.imwrite(str(folder / depth / f"{name}.png"), units)
        (folder / "calib" / f"{name}.txt").write_text(CALIBRATION)


@pytest.mark.parametrize(("color", "depth"), [("image_data", "dense_depth"), ("images", "depth")])
def test_both_layouts_are_read(tmp_path: Path, color: str, depth: str) -> None:
    write_sequence(tmp_path / "road", color, depth)
    frames = check_source(lambda: open_source(tmp_path / "road"))
    assert [f.name for f in frames] == list(NAMES)
    assert [f.stamp_ns for f in frames] == [ms * 1_000_000 for ms in STAMPS_MS]
    for frame in frames:
        assert frame.T_map_camera is None
        assert frame.intrinsics == CAMERA
        assert frame.depth_unit_m == 1 / 256
    frame = frames[0]
    written = cv2.imread(str(tmp_path / "road" / color / f"{NAMES[0]}.png"))
    np.testing.assert_array_equal(frame.rgb, cv2.cvtColor(written, cv2.COLOR_BGR2RGB))


def test_the_unit_of_the_depth_sets_the_height_of_the_camera(tmp_path: Path) -> None:
    write_sequence(tmp_path / "road")
    for unit_m, height_m in ((None, 2.0), (1 / 512, 1.0)):
        source = open_source(tmp_path / "road", SourceConfig(depth_unit_m=unit_m))
        T_base_camera = estimate_mount(next(iter(source)))
        assert T_base_camera.position_m[2] == pytest.approx(height_m, abs=0.01)


def test_frames_are_chosen_and_missing_parts_counted(tmp_path: Path) -> None:
    write_sequence(tmp_path / "road")
    chosen = open_source(tmp_path / "road", SourceConfig(start=0, stop=3, every=2))
    assert [f.name for f in chosen] == [NAMES[0], NAMES[2]]
    (tmp_path / f"road/image_data/{NAMES[0]}.png").unlink()
    (tmp_path / f"road/calib/{NAMES[1]}.txt").unlink()
    (tmp_path / "road/dense_depth/1623721493000.png").write_bytes(b"never read: it has no colour")
    source = open_source(tmp_path / "road")
    assert source.frame_count == 4
    assert [f.name for f in source] == [NAMES[2]]
    assert source.skipped == {"no colour image": 2, "no calibration": 1}
    (tmp_path / f"road/dense_depth/{NAMES[2]}.png").unlink()
    assert not list(source)
    assert source.skipped == {"no colour image": 2, "no calibration": 1, "no depth image": 1}


def test_a_folder_that_may_not_be_read_is_one_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_sequence(tmp_path / "road")

    def refuse(path: Path) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(InputError, match="Permission denied"):
        open_source(tmp_path / "road", SourceConfig(format="orfd"))


def test_other_folders_are_not_taken(tmp_path: Path) -> None:
    assert not orfd.recognises(tmp_path)
    with pytest.raises(InputError, match="expected folders image_data or images"):
        open_source(tmp_path, SourceConfig(format="orfd"))
    for name in ("images", "depth", "calib"):
        assert not orfd.recognises(tmp_path)
        (tmp_path / name).mkdir()
    assert orfd.recognises(tmp_path)
    (tmp_path / "images/panel.png").touch()
    with pytest.raises(InputError, match="images named by their time"):
        open_source(tmp_path)


@pytest.mark.parametrize(
    ("file", "change", "match"),
    [("dense_depth/1623721491991.png", (lambda b: b[:-40]), "truncated"),
     ("image_data/1623721491991.png", (lambda _: b"a stranger"), "expected a PNG, JPEG"),
     ("calib/1623721491991.txt", (lambda _: b""), "expected one line 'cam_K:'"),
     ("calib/1623721491991.txt", (lambda b: b + b), "expected one line 'cam_K:'"),
     ("calib/1623721491991.txt", (lambda b: b[:30]), "expected"),
     ("calib/1623721491991.txt", (lambda b: b.replace(b"186.0", b"0.0")), "positive focal lengths"),
     ("calib/1623721491991.txt", (lambda b: b.replace(b"186.0", b"nan")), "finite"),
     ("calib/1623721491991.txt", (lambda b: b.replace(b"78.0", b"640.0")), "inside the image"),
     ("calib/1623721491991.txt", (lambda b: b.replace(b"47.0", b"wide")), "expected rows of 9"),
     ("calib/1623721491991.txt", (lambda b: b.replace(b"186.0 0.0", b"186.0 5.0")), "fx 0 cx"),
     ("calib/1623721491991.txt", (lambda b: b.replace(b"0.0 0.0 1.0", b"0.0 0.0 2.0")), "fx 0 cx")],
)  # fmt: skip
def test_what_is_wrong_is_named(
    tmp_path: Path, file: str, change: Callable[[bytes], bytes], match: str
) -> None:
    write_sequence(tmp_path / "road")
    path = tmp_path / "road" / file
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(InputError, match=match) as caught:
        list(open_source(tmp_path / "road"))
    assert str(path) in str(caught.value)


def test_depth_of_another_size_or_kind_is_refused(tmp_path: Path) -> None:
    write_sequence(tmp_path / "road")
    for image in (np.zeros((45, 80), np.uint16), np.zeros((90, 160), np.uint8)):
        cv2.imwrite(str(tmp_path / f"road/dense_depth/{NAMES[1]}.png"), image)
        with pytest.raises(InputError, match=NAMES[1]):
            list(open_source(tmp_path / "road"))


@given(
    st.binary(max_size=200)
    | st.binary(max_size=80).map(lambda b: b"cam_K:" + b)
    | st.lists(st.floats().map(str), min_size=9, max_size=9).map(lambda v: f"cam_K: {' '.join(v)}".encode())
)
def test_random_calibrations_are_one_error_or_a_camera(content: bytes) -> None:
    with suppress(InputError):
        camera = parse_calibration(content, "calib.txt", 160, 90)
        assert camera.fx > 0


def test_the_real_road(data_dir: Path) -> None:
    frames = check_source(lambda: open_source(data_dir / "orfd"))
    assert len(frames) == 6
    assert frames[-1].stamp_ns - frames[0].stamp_ns == 895_000_000
    heights = []
    for frame in frames:
        assert (frame.intrinsics.width, frame.intrinsics.height) == (1280, 720)
        assert 0.8 < np.isfinite(frame.depth_m).mean() < 0.9
        T_base_camera = estimate_mount(frame)
        heights.append(T_base_camera.position_m[2])
        assert 6.5 < np.rad2deg(np.arcsin(-T_base_camera.matrix[2, 2])) < 8
    assert min(heights) > 1.9
    assert max(heights) < 2.05
