"""`swardmap record`: any source to an MCAP file, read back by us, by the format's library and by rosbags."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from swardmap.cli.app import run
from swardmap.geometry import Intrinsics
from swardmap.io import open_source
from swardmap.io.bags.record_messages import CAMERA_FRAME, COLOR, DEPTH
from swardmap.io.sources.folder import write_folder
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("record") / "garden"
    write_folder(AnalyticSource(garden_scene(0), tuple(lane_poses(6, step_m=0.4)), SMALL), folder)
    return folder


@pytest.mark.parametrize("images", ["raw", "png"])
@pytest.mark.parametrize("depth", ["raw", "png"])
def test_a_recording_in_another_format_is_the_same(
    recording: Path, tmp_path: Path, images: str, depth: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new/folder/drive.mcap"
    assert run(["record", str(recording), "-o", str(out), "--images", images, "--depth", depth]) == 0
    assert capsys.readouterr().out == f"6 frames in {out}, {out.stat().st_size / 1e6:.1f} MB\n"
    given, found = list(open_source(recording)), list(open_source(out))
    assert len(found) == len(given) == 6
    for one, two in zip(given, found, strict=True):
        assert (one.stamp_ns, one.intrinsics, one.depth_unit_m) == (
            two.stamp_ns,
            two.intrinsics,
            two.depth_unit_m,
        )
        np.testing.assert_array_equal(one.rgb, two.rgb)
        np.testing.assert_array_equal(one.depth, two.depth)
        assert one.T_map_camera is not None
        assert two.T_map_camera is not None
        np.testing.assert_allclose(one.T_map_camera.matrix, two.T_map_camera.matrix, atol=1e-12)
    assert [p.name for p in out.parent.iterdir()] == ["drive.mcap"]


def test_others_read_it_by_the_schemas_it_carries(recording: Path, tmp_path: Path) -> None:
    """Foxglove knows a message by the name and the definition in the file; so does mcap's ROS 2 decoder."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    out = tmp_path / "drive.mcap"
    assert run(["record", str(recording), "-o", str(out)]) == 0
    frames = list(open_source(recording))
    found: dict[str, list[Any]] = {}
    with out.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, _, message in reader.iter_decoded_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            found.setdefault(channel.topic, []).append(message)
    for frame, color, depth, info in zip(
        frames,
        found[f"{COLOR}/image_raw"],
        found[f"{DEPTH}/image_raw"],
        found[f"{DEPTH}/camera_info"],
        strict=True,
    ):
        for message in (color, depth, info):
            stamp = message.header.stamp
            assert (stamp.sec * 10**9 + stamp.nanosec, message.header.frame_id) == (
                frame.stamp_ns,
                CAMERA_FRAME,
            )
        assert (color.encoding, depth.encoding) == ("rgb8", "16UC1")
        np.testing.assert_array_equal(np.frombuffer(color.data, np.uint8).reshape(120, 160, 3), frame.rgb)
        np.testing.assert_array_equal(np.frombuffer(depth.data, "<u2").reshape(120, 160), frame.depth)
        np.testing.assert_array_equal(np.reshape(info.k, (3, 3)), SMALL.matrix)
    moved = [message.transforms[0].transform.translation.x for message in found["/tf"]]
    assert moved == pytest.approx([f.T_map_camera.position_m[0] for f in frames if f.T_map_camera])

    with AnyReader([out]) as bag:  # what is sent once is in the file once, and for late listeners
        counts = {connection.topic: connection.msgcount for connection in bag.connections}
        assert counts == {topic: len(messages) for topic, messages in found.items()}
        for connection, stamp_ns, data in bag.messages():
            header = getattr(bag.deserialize(data, connection.msgtype), "header", None)
            assert header is None or header.stamp.sec * 10**9 + header.stamp.nanosec == stamp_ns


def test_what_is_recorded_maps_as_its_source(recording: Path, tmp_path: Path) -> None:
    from swardmap.io.maps.map_files import read_map

    assert run(["record", str(recording), "-o", str(tmp_path / "drive.mcap")]) == 0
    grids = []
    for name, source in (("a", recording), ("b", tmp_path / "drive.mcap")):
        arguments = ["map", str(source), "-o", str(tmp_path / name), "--segmenter", "colour"]
        assert run([*arguments, "--pictures", "0"]) == 0
        grids.append(read_map(tmp_path / name / "map.yaml"))
    assert grids[0].spec == grids[1].spec
    np.testing.assert_array_equal(grids[0].classes, grids[1].classes)


def test_json_and_a_part(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "drive.mcap"
    arguments = ["record", str(recording), "-o", str(out), "--json", "--duration", "0.5"]
    assert run([*arguments, "--images", "jpeg"]) == 0
    captured = capsys.readouterr()
    facts = json.loads(captured.out)
    assert captured.err == ""
    assert facts.pop("seconds") >= 0
    assert facts == {
        "file": str(out),
        "frames": 3,  # 0.2 s apart
        "bytes": out.stat().st_size,
        "skipped": {},
        "stopped": False,
    }
    assert run([*arguments, "--frames", "2", "--overwrite"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == len(list(open_source(out))) == 2
    assert run([*arguments]) == 1
    assert "--overwrite" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [(["-o", "drive.bag"], "ends in .mcap"),
     (["-o", "a.mcap", "--images", "gif"], "one of raw, png, jpeg"),
     (["-o", "a.mcap", "--depth", "jpeg"], "one of raw, png"),
     (["-o", "/proc/nowhere/a.mcap"], "cannot write"),
     (["-o", "closed/a.mcap"], "cannot write closed/a.mcap: "),
     (["-o", "a.mcap", "--format", "eden"], "eden")],
)  # fmt: skip
def test_what_cannot_be_is_one_line_and_leaves_nothing(
    options: list[str],
    words: str,
    recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "closed").write_bytes(b"a file where the folder should be")
    assert run(["record", str(recording), *options]) == 1
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert words in said[0]
    assert [p.name for p in tmp_path.iterdir()] == ["closed"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_may_not_be_written(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tmp_path.chmod(0o500)
    assert run(["record", str(recording), "-o", str(tmp_path / "a.mcap")]) == 1
    assert "Permission denied" in capsys.readouterr().err


def test_a_full_disk_keeps_the_earlier_file(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "drive.mcap"
    assert run(["record", str(recording), "-o", str(out), "--frames", "1"]) == 0
    before = out.read_bytes()

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    capsys.readouterr()
    assert run(["record", str(recording), "-o", str(out), "--overwrite", "--json"]) == 1
    assert capsys.readouterr().err == f"swardmap: cannot write {out}: No space left on device\n"
    assert out.read_bytes() == before
    assert list(tmp_path.iterdir()) == [out]


def test_ctrl_c_keeps_what_came_and_says_that_it_is_not_all(recording: Path, tmp_path: Path) -> None:
    many = tmp_path / "many"
    frame = next(iter(AnalyticSource(garden_scene(0), tuple(lane_poses(1)), SMALL)))
    write_folder((replace(frame, name=f"{i:06d}", stamp_ns=i) for i in range(400)), many)
    command = [sys.executable, "-m", "swardmap", "record", str(many), "-o", str(tmp_path / "a.mcap")]
    with subprocess.Popen([*command, "--images", "png"], stderr=subprocess.PIPE, text=True) as running:
        while not any(file.stat().st_size for file in tmp_path.glob(".a.mcap.*/a.mcap")):
            assert running.poll() is None
            time.sleep(0.01)
        running.send_signal(signal.SIGINT)
        _, said = running.communicate(timeout=60)
    frames = len(list(open_source(tmp_path / "a.mcap")))
    assert running.returncode == 130
    assert f"interrupted: {tmp_path}/a.mcap holds the {frames} frames that were finished\n" in said
    assert 0 < frames < 400
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", "many"]


class TestCamera:
    """Through the SDK's software device."""

    def test_a_camera_for_a_while(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        from tests.realsense import SETTINGS, color_image, plug_in, steady

        plug_in(monkeypatch, steady(12))
        out = tmp_path / "drive.mcap"
        arguments = ["record", "realsense:123", "-o", str(out), "--json", "--duration", "0.25", *SETTINGS]
        assert run(arguments) == 0
        facts = json.loads(capsys.readouterr().out)
        frames = list(open_source(out))
        assert facts["frames"] == len(frames) == 8  # 33.3 ms apart, less than 250 ms after the first
        assert not facts["stopped"]
        for number, frame in enumerate(frames, start=1):  # the SDK gives the images of the first pair apart
            np.testing.assert_array_equal(frame.rgb, color_image(number))
            assert frame.depth_unit_m == 0.001
            assert frame.T_map_camera is None

    def test_ctrl_c_is_how_a_camera_ends(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        from tests.realsense import SETTINGS, ctrl_c_after, plug_in, steady

        plug_in(monkeypatch, ctrl_c_after(monkeypatch, 8, steady(9)))
        before = signal.getsignal(signal.SIGINT)
        assert run(["record", "realsense:", "-o", str(tmp_path / "a.mcap"), "--json", *SETTINGS]) == 0
        facts = json.loads(capsys.readouterr().out)
        assert facts["stopped"]
        assert facts["frames"] == len(list(open_source(tmp_path / "a.mcap"))) == 8
        assert signal.getsignal(signal.SIGINT) is before

    def test_ctrl_c_before_the_first_frame_leaves_nothing(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        from tests.realsense import SETTINGS, plug_in

        plug_in(monkeypatch, lambda _: os.kill(os.getpid(), signal.SIGINT))
        assert run(["record", "realsense:", "-o", str(tmp_path / "a.mcap"), *SETTINGS]) == 130
        said = capsys.readouterr().err
        assert said == "swardmap: interrupted: before the first frame came; nothing was written\n"
        assert list(tmp_path.iterdir()) == []

    def test_a_camera_that_is_lost_keeps_what_came_and_fails(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        from tests.realsense import SETTINGS, plug_in, steady

        plug_in(monkeypatch, steady(5))
        patience = ["--set", "camera.reconnect_s=0.5", "--set", "camera.timeout_s=0.3"]
        assert run(["record", "realsense:", "-o", str(tmp_path / "a.mcap"), *SETTINGS, *patience]) == 1
        said = capsys.readouterr().err
        assert "no image that can be used for" in said
        assert "a.mcap holds the 4 frames that came." in said  # the path before it may be cut
        assert len(list(open_source(tmp_path / "a.mcap"))) == 4

    def test_a_camera_that_is_not_there(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        from tests.realsense import SETTINGS, plug_in, steady

        plug_in(monkeypatch, steady(5))
        assert run(["record", "realsense:9", "-o", str(tmp_path / "a.mcap"), *SETTINGS]) == 1
        assert "no RealSense camera 9 is connected" in capsys.readouterr().err
        assert list(tmp_path.iterdir()) == []
