"""3DMatch sequences: poses, lost tracking, levelling of a tilted world; made here, and the real one."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.geometry import Intrinsics, Pose, deproject, mount_pose
from swardmap.io import open_source
from swardmap.io.sources import threedmatch
from swardmap.io.sources.threedmatch import parse_pose
from swardmap.synth.analytic import AnalyticSource, Box, Scene, StereoNoise
from swardmap.types import Frame
from tests.io.contract import check_source

CAMERA = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
ROOM = Scene((Box((2.5, 0.0), (1.2, 2.0, 0.7)), Box((4.5, 0.0), (0.4, 9.0, 2.4))), name="room")
K_TEXT = "115 0 79.5\n0 115 59.5\n0 0 1\n"


def room_poses() -> list[Pose]:
    """Somebody walks and looks about with the camera in the hand."""
    turns = ((0.0, 28.0, 3.0, 0.0), (0.3, 35.0, -4.0, 15.0), (0.6, 30.0, 2.0, -20.0), (0.2, 25.0, 0.0, 10.0))
    return [mount_pose(1.4, pitch, roll, yaw, (x, 0.0), parent="map") for x, pitch, roll, yaw in turns]


def write_sequence(folder: Path, T_world_map: Pose, noise: StereoNoise | None = None) -> list[Frame]:
    """The room as 3DMatch would write it, in another world; returns the frames as they were."""
    folder.mkdir(parents=True)
    (folder / "camera-intrinsics.txt").write_text(K_TEXT)
    frames = list(AnalyticSource(ROOM, tuple(room_poses()), CAMERA, noise=noise))
    for i, frame in enumerate(frames):
        assert frame.T_map_camera is not None
        stem = folder / f"frame-{10 * i:06d}"
        cv2.imwrite(f"{stem}.color.png", frame.rgb[..., ::-1])
        depth = np.where(frame.depth == 0, 65535, frame.depth).astype(np.uint16) if i % 2 else frame.depth
        cv2.imwrite(f"{stem}.depth.png", depth)
        np.savetxt(f"{stem}.pose.txt", (T_world_map @ frame.T_map_camera).matrix, fmt="%.8e", delimiter="\t")
    return frames


def pose_of(yaw: float, pitch: float, roll: float, shift: tuple[float, float, float]) -> Pose:
    matrix = mount_pose(0.0, pitch, roll, yaw).matrix.copy()
    matrix[:3, 3] = shift
    return Pose("world", "map", matrix)


WORLDS = {
    "level": Pose.identity("world", "map"),
    "first camera": replace(room_poses()[0].inverse(), parent="world"),
    "y up": pose_of(30, 0, 0, (3, 1, -2)),
    "upside down": Pose("world", "map", np.diag([1.0, -1, -1, 1])),
    "far away": pose_of(-110, 40, 70, (400.0, -300.0, 250.0)),
}


def points_in_map(frame: Frame) -> NDArray[np.float64]:
    assert frame.T_map_camera is not None
    xyz = frame.T_map_camera.apply(deproject(frame.depth_m, frame.intrinsics)).reshape(-1, 3)
    return xyz[np.isfinite(xyz[:, 2])]


def test_what_was_written_is_read(tmp_path: Path) -> None:
    written = write_sequence(tmp_path / "room", WORLDS["far away"])
    read = check_source(lambda: open_source(tmp_path / "room", SourceConfig(level=False)))
    assert [f.name for f in read] == [f"frame-{10 * i:06d}" for i in range(4)]
    assert [f.stamp_ns for f in read] == [10 * i * 33_333_333 for i in range(4)]
    for one, two in zip(written, read, strict=True):
        np.testing.assert_array_equal(one.rgb, two.rgb)
        np.testing.assert_array_equal(one.depth, two.depth)  # 65535 became 0, "no reading"
        assert one.T_map_camera is not None
        assert two.T_map_camera is not None
        assert two.intrinsics == CAMERA
        expected = (WORLDS["far away"] @ one.T_map_camera).matrix
        np.testing.assert_allclose(two.T_map_camera.matrix, expected, atol=1e-5)
        assert two.T_map_camera.parent == "map"


@pytest.mark.parametrize("world", WORLDS)
def test_a_levelled_map_has_its_floor_at_zero(tmp_path: Path, world: str) -> None:
    written = write_sequence(tmp_path / "room", WORLDS[world], StereoNoise())
    for one, two in zip(written, open_source(tmp_path / "room"), strict=True):
        assert one.T_map_camera is not None
        assert two.T_map_camera is not None
        true_z = points_in_map(one)[:, 2]
        error = points_in_map(two)[:, 2] - true_z
        assert np.abs(error).max() < 0.02  # of everything, not of the floor alone: no tilt is left
        height = two.T_map_camera.position_m[2] - one.T_map_camera.position_m[2]
        assert abs(height) < 0.005


@pytest.mark.parametrize("world", WORLDS)
def test_furniture_coincides_in_all_frames(tmp_path: Path, world: str) -> None:
    """Distances within the map are those of the room: all frames were turned by the same."""
    written = write_sequence(tmp_path / "room", WORLDS[world])
    offsets = []
    for one, two in zip(written, open_source(tmp_path / "room"), strict=True):
        table = np.abs(points_in_map(one)[:, 2] - 0.7) < 0.005
        assert np.count_nonzero(table) > 50
        true, got = points_in_map(one)[table], points_in_map(two)[table]
        offsets.append((true[:, :2].mean(axis=0), got[:, :2].mean(axis=0)))
    for (true_a, got_a), (true_b, got_b) in pairwise(offsets):
        assert abs(np.linalg.norm(true_a - true_b) - np.linalg.norm(got_a - got_b)) < 0.01


def test_a_level_world_keeps_its_heading(tmp_path: Path) -> None:
    written = write_sequence(tmp_path / "room", WORLDS["level"])
    for one, two in zip(written, open_source(tmp_path / "room"), strict=True):
        assert one.T_map_camera is not None
        assert two.T_map_camera is not None
        np.testing.assert_allclose(two.T_map_camera.matrix, one.T_map_camera.matrix, atol=4e-3)


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "-1.#INF", "1.#QNAN", "-1.#IND00"])
def test_frames_with_lost_tracking_are_counted(tmp_path: Path, text: str) -> None:
    write_sequence(tmp_path / "room", WORLDS["first camera"])
    (tmp_path / "room/frame-000010.pose.txt").write_text("\n".join([" ".join([text] * 4)] * 4))
    frames = check_source(lambda: open_source(tmp_path / "room"))
    assert [f.name for f in frames] == ["frame-000000", "frame-000020", "frame-000030"]
    source = open_source(tmp_path / "room")
    assert list(source)
    assert source.skipped == {"tracking lost": 1}
    assert source.frame_count == 4


def test_missing_parts_are_counted(tmp_path: Path) -> None:
    write_sequence(tmp_path / "room", WORLDS["level"])
    for name in ("frame-000000.color.png", "frame-000010.depth.png", "frame-000020.pose.txt"):
        (tmp_path / "room" / name).unlink()
    source = open_source(tmp_path / "room")
    assert [f.name for f in source] == ["frame-000030"]
    assert source.skipped == {"no colour image": 1, "no depth image": 1, "no pose": 1}
    (tmp_path / "room/frame-000030.pose.txt").unlink()
    with pytest.raises(InputError, match=r"none of the 4 frames chosen can be used .*2 x no pose"):
        open_source(tmp_path / "room")


def test_frames_are_chosen_by_place_and_in_order_of_number(tmp_path: Path) -> None:
    write_sequence(tmp_path / "room", WORLDS["level"])
    for kind in ("color.png", "depth.png", "pose.txt"):  # seven digits sort before six as text
        (tmp_path / f"room/frame-000000.{kind}").rename(tmp_path / f"room/frame-1000000.{kind}")
    source = open_source(tmp_path / "room", SourceConfig(start=1, every=2))
    assert source.frame_count == 2
    assert [f.name for f in source] == ["frame-000020", "frame-1000000"]


def test_sub_folders_and_intrinsics_above(tmp_path: Path) -> None:
    write_sequence(tmp_path / "scene/seq-01", WORLDS["level"])
    (tmp_path / "scene/seq-01/camera-intrinsics.txt").rename(tmp_path / "scene/camera-intrinsics.txt")
    for path in (tmp_path / "scene", tmp_path / "scene/seq-01"):
        assert len(list(open_source(path))) == 4
    write_sequence(tmp_path / "scene/seq-02", WORLDS["level"])
    with pytest.raises(InputError, match=r"several sequences.*seq-01, seq-02"):
        open_source(tmp_path / "scene")
    assert open_source(tmp_path / "scene/seq-02").name == "seq-02"


def test_a_folder_that_may_not_be_read_is_one_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_sequence(tmp_path / "room", WORLDS["level"])

    def refuse(path: Path) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(InputError, match="Permission denied"):
        open_source(tmp_path / "room", SourceConfig(format="3dmatch"))


def test_other_folders_are_not_taken(tmp_path: Path) -> None:
    assert not threedmatch.recognises(tmp_path)
    (tmp_path / "camera-intrinsics.txt").write_text(K_TEXT)
    assert not threedmatch.recognises(tmp_path)
    assert not threedmatch.recognises(tmp_path / "camera-intrinsics.txt")
    with pytest.raises(InputError, match="expected files such as frame-"):
        open_source(tmp_path, SourceConfig(format="3dmatch"))


def test_a_depth_unit_can_be_set(tmp_path: Path) -> None:
    write_sequence(tmp_path / "room", WORLDS["level"])
    frame = next(iter(open_source(tmp_path / "room", SourceConfig(depth_unit_m=0.0002, level=False))))
    assert frame.depth_unit_m == 0.0002


def test_a_world_without_floor_is_refused_or_taken_as_it_is(tmp_path: Path) -> None:
    write_sequence(tmp_path / "room", WORLDS["level"])
    wall = np.full((120, 160), 2000, np.uint16)
    for i in range(4):
        cv2.imwrite(str(tmp_path / f"room/frame-{10 * i:06d}.depth.png"), wall)
        matrix = mount_pose(1.5, 0.0, parent="world").matrix
        np.savetxt(tmp_path / f"room/frame-{10 * i:06d}.pose.txt", matrix)
    with pytest.raises(InputError, match=r"no ground found.*set source\.level=false"):
        open_source(tmp_path / "room")
    assert len(list(open_source(tmp_path / "room", SourceConfig(level=False)))) == 4


def test_cameras_that_disagree_about_up_are_refused(tmp_path: Path) -> None:
    write_sequence(tmp_path / "room", WORLDS["level"])
    for i in range(4):
        matrix = mount_pose(1.5, 20.0, roll_deg=90.0 * i, parent="world").matrix
        np.savetxt(tmp_path / f"room/frame-{10 * i:06d}.pose.txt", matrix)
    with pytest.raises(InputError, match="cannot tell what is up"):
        open_source(tmp_path / "room")


@pytest.mark.parametrize(
    ("name", "change", "match"),
    [("frame-000010.depth.png", (lambda b: b[:-40]), "truncated"),
     ("frame-000000.depth.png", (lambda b: b[:-40]), "truncated"),
     ("frame-000010.color.png", (lambda _: b"GIF89a, says a stranger"), "expected a PNG, JPEG"),
     ("frame-000010.pose.txt", (lambda b: b[:60]), "expected 4 rows of 4 numbers"),
     ("frame-000010.pose.txt", (lambda b: b + b"0 0 0 1"), "expected 4 rows of 4 numbers"),
     ("frame-000010.pose.txt", (lambda _: b"2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1"), "expected a rotation"),
     ("frame-000010.pose.txt", (lambda _: b"0 " * 16), "expected 4 rows of 4 numbers"),
     ("frame-000010.pose.txt", (lambda _: b"one two three four\n" * 4), "expected rows of 4"),
     ("camera-intrinsics.txt", (lambda _: b"0 0 79.5\n0 115 59.5\n0 0 1"), "positive focal lengths"),
     ("camera-intrinsics.txt", (lambda _: b"nan 0 79\n0 115 59\n0 0 1"), "expected"),
     ("camera-intrinsics.txt", (lambda _: b"115 0 320\n0 115 240\n0 0 1"), "another image size"),
     ("camera-intrinsics.txt", (lambda _: b"115 0 79.5\n0 115 59.5\n1 1 1"), "expected rows fx 0 cx"),
     ("camera-intrinsics.txt", (lambda _: b""), "expected 3 rows of 3 numbers")],
)  # fmt: skip
def test_what_is_wrong_is_named(
    tmp_path: Path, name: str, change: Callable[[bytes], bytes], match: str
) -> None:
    write_sequence(tmp_path / "room", WORLDS["level"])
    file = tmp_path / "room" / name
    file.write_bytes(change(file.read_bytes()))
    with pytest.raises(InputError, match=match) as caught:
        list(open_source(tmp_path / "room", SourceConfig(level=False)))
    assert name in str(caught.value)


@pytest.mark.parametrize("level", [True, False])
@pytest.mark.parametrize("name", ["color", "depth"])
def test_images_of_another_size_are_refused(tmp_path: Path, name: str, level: bool) -> None:
    write_sequence(tmp_path / "room", WORLDS["level"])
    image = np.zeros((60, 80), np.uint16) if name == "depth" else np.zeros((60, 80, 3), np.uint8)
    cv2.imwrite(str(tmp_path / f"room/frame-000010.{name}.png"), image)
    with pytest.raises(InputError, match="frame-000010"):
        list(open_source(tmp_path / "room", SourceConfig(level=level)))


def test_missing_intrinsics_are_named(tmp_path: Path) -> None:
    write_sequence(tmp_path / "room", WORLDS["level"])
    (tmp_path / "room/camera-intrinsics.txt").unlink()
    with pytest.raises(InputError, match=r"camera-intrinsics\.txt"):
        open_source(tmp_path / "room", SourceConfig(format="3dmatch"))


numbers = st.lists(st.floats(width=32).map(str), min_size=16, max_size=16).map(lambda v: " ".join(v).encode())


@given(st.binary(max_size=200) | numbers | st.text("0123456789.-+einfa# \n\t", max_size=100).map(str.encode))
def test_random_pose_files_are_one_error_a_pose_or_lost(content: bytes) -> None:
    with suppress(InputError):
        pose = parse_pose(content, "pose.txt")
        assert pose is None or np.isfinite(pose.matrix).all()


@given(st.binary(max_size=120) | st.text("0123456789.-+ein \n", max_size=80).map(str.encode))
def test_random_intrinsics_are_one_error_or_a_camera(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    folder = tmp_path_factory.getbasetemp() / "3dmatch-intrinsics"
    if not folder.exists():
        write_sequence(folder, WORLDS["level"])
    (folder / "camera-intrinsics.txt").write_bytes(content)
    with suppress(InputError):
        source = open_source(folder, SourceConfig(level=False, stop=1))
        assert next(iter(source)).intrinsics.fx > 0


def test_the_real_room_is_levelled(data_dir: Path) -> None:
    frames = check_source(lambda: open_source(data_dir / "rgbd_3dmatch"))
    assert [f.name for f in frames] == [f"frame-{i:06d}" for i in (0, 1, 2, 116, 422)]
    for frame in frames:
        assert frame.T_map_camera is not None
        assert 1.35 < frame.T_map_camera.position_m[2] < 1.55  # held at the height of a chest
        assert abs(frame.T_map_camera.matrix[2, 0]) < 0.12  # about upright
    for frame in frames[:4]:
        z = points_in_map(frame)[:, 2]
        floor = z[np.abs(z) < 0.1]
        assert len(floor) > 0.2 * len(z)
        assert abs(np.median(floor)) < 0.01
        assert np.mean(z < -0.1) < 0.01


def test_furniture_of_the_real_room_coincides(data_dir: Path) -> None:
    """The front edge of the sofa's seat in the first three frames is in the same cells of 5 cm."""
    edges = []
    for frame in list(open_source(data_dir / "rgbd_3dmatch"))[:3]:
        xyz = points_in_map(frame)
        sofa = xyz[(xyz[:, 2] > 0.3) & (xyz[:, 2] < 0.7) & (xyz[:, 0] > -0.7) & (xyz[:, 0] < 1.0)]
        sofa = sofa[(sofa[:, 1] > -0.8) & (sofa[:, 1] < 0.6)]
        assert len(sofa) > 10_000
        edges.append(np.percentile(sofa[:, :2], [2, 50, 98], axis=0))
    for edge in edges[1:]:
        assert np.abs(edge - edges[0]).max() < 0.05
