"""`swardmap view`: from any source to an .rrd file or a viewer, read back by Rerun's own reader."""

import json
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from swardmap.cli.app import run
from swardmap.geometry import Intrinsics
from swardmap.io import open_source
from swardmap.io.maps.map_files import read_costmap, read_map
from swardmap.io.sources.folder import write_folder
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from tests.rrd import image, numbers, read

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)

MOUNT = ["--set", "mount.height_m=0.9", "--set", "mount.pitch_deg=22"]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("view") / "garden"
    write_folder(AnalyticSource(garden_scene(0), tuple(lane_poses(6, step_m=0.4)), SMALL), folder)
    return folder


def test_a_file_shows_what_map_writes(recording: Path, tmp_path: Path) -> None:
    options = ["--segmenter", "truth", "--set", "costmap.margin_m=0.2"]
    assert run(["view", str(recording), "--save", str(tmp_path / "a.rrd"), *options]) == 0
    assert run(["map", str(recording), "-o", str(tmp_path / "out"), "--pictures", "0", *options]) == 0
    rows, last = read(tmp_path / "a.rrd"), 5
    grid, costmap = read_map(tmp_path / "out/map.yaml"), read_costmap(tmp_path / "out/costmap.yaml")
    classes = image(rows, "/map/classes", "SegmentationImage", last)[::-1]
    np.testing.assert_array_equal(classes, grid.classes)
    np.testing.assert_array_equal(image(rows, "/map/costs", "SegmentationImage", last)[::-1], costmap.costs)
    for number, frame in enumerate(open_source(recording)):
        np.testing.assert_array_equal(image(rows, "/world/camera/photo", "Image", number), frame.rgb)
        np.testing.assert_array_equal(image(rows, "/world/camera/depth", "DepthImage", number), frame.depth)
        mask = image(rows, "/world/camera/mask", "SegmentationImage", number)
        np.testing.assert_array_equal(mask, frame.labels)
        for stage in ("read", "segment", "map"):
            assert numbers(rows[f"/timings/{stage}"]["Scalars:scalars"][number])[0] >= 0


def test_json_a_part_and_an_earlier_file(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.rrd"
    arguments = ["view", str(recording), "--save", str(path), "--json", "--segmenter", "colour"]
    assert run([*arguments, "--frames", "2", "--jpeg", "80"]) == 0
    captured = capsys.readouterr()
    facts = json.loads(captured.out)
    assert captured.err == ""
    assert (facts["to"], facts["frames"], facts["skipped"], facts["stopped"]) == (str(path), 2, {}, False)
    assert set(facts["timings_ms"]) == {"segment", "map"}
    assert sorted(read(path)["/world/camera/photo"]["EncodedImage:blob"]) == [0, 1]
    before = path.read_bytes()
    assert run(arguments) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert path.read_bytes() == before
    assert run([*arguments, "--overwrite", "--duration", "0.5"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 3  # 0.2 s apart


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [(["--save", "a.rrd", "--connect", "rerun+http://127.0.0.1:9/proxy"], 2, "expected --save or --connect"),
     (["--save", "a.bag"], 1, "ends in .rrd"), (["--save", "a.rrd", "--jpeg", "0"], 2, "--jpeg"),
     (["--connect", "rerun+http://127.0.0.1:9/proxy"], 1, "no Rerun viewer answers at"),
     (["--save", "/proc/no/a.rrd"], 1, "cannot write /proc/no/a.rrd"),
     (["--save", "a.rrd", "--segmenter", "none.onnx"], 1, "none.onnx")],
)  # fmt: skip
def test_what_cannot_be_is_told_and_leaves_nothing(
    options: list[str],
    code: int,
    words: str,
    recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["view", str(recording), *options]) == code
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_without_rerun_the_command_is_named(
    recording: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    assert run(["view", str(recording)]) == 1
    assert "pip install 'swardmap[view]'" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore:RRD file has no footer")  # that program ends by Ctrl-C
def test_another_viewer_gets_all_of_it(recording: Path, tmp_path: Path) -> None:
    """Rerun's own program, which listens and writes what comes to a file in place of a screen."""
    program = shutil.which("rerun")
    if program is None:
        pytest.skip("the program rerun is not on the PATH")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    got, sent = tmp_path / "got.rrd", tmp_path / "sent.rrd"
    command = [program, "--port", str(port), "--bind", "127.0.0.1", "--save", str(got)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as viewer:
        try:
            deadline = time.monotonic() + 30
            while time.monotonic() < deadline:
                with socket.socket() as probe:
                    if probe.connect_ex(("127.0.0.1", port)) == 0:
                        break
                time.sleep(0.05)
            options = ["--segmenter", "truth"]
            url = f"rerun+http://127.0.0.1:{port}/proxy"
            assert run(["view", str(recording), "--connect", url, *options]) == 0
            time.sleep(0.5)
        finally:
            viewer.send_signal(signal.SIGINT)
    assert run(["view", str(recording), "--save", str(sent), *options]) == 0
    one, two = read(got), read(sent)
    for path, kind in (("/world/camera/photo", "Image"), ("/map/classes", "SegmentationImage")):
        numbers_seen = sorted(two[path][f"{kind}:buffer"])
        assert sorted(one[path][f"{kind}:buffer"]) == numbers_seen
        for number in numbers_seen:
            np.testing.assert_array_equal(image(one, path, kind, number), image(two, path, kind, number))


class TestCamera:
    """Through the SDK's software device."""

    def test_a_camera_is_watched_until_ctrl_c(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        from tests.realsense import SETTINGS, color_image, ctrl_c_after, plug_in, steady

        plug_in(monkeypatch, ctrl_c_after(monkeypatch, 5, steady(6)))
        arguments = ["view", "realsense:123", "--save", str(tmp_path / "a.rrd"), "--segmenter", "colour"]
        assert run([*arguments, "--json", *SETTINGS, *MOUNT, "--set", "camera.queue=15"]) == 0
        facts = json.loads(capsys.readouterr().out)
        assert facts["stopped"]
        assert facts["frames"] == 5  # the SDK gives the images of the first pair apart
        rows = read(tmp_path / "a.rrd")
        for number in range(5):
            photo = image(rows, "/world/camera/photo", "Image", number)
            np.testing.assert_array_equal(photo, color_image(number + 1))
            assert number in rows["/latency/image"]["Scalars:scalars"]

    def test_a_camera_that_is_lost_keeps_what_came_and_fails(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        from tests.realsense import SETTINGS, plug_in, steady

        plug_in(monkeypatch, steady(3))
        patience = ["--set", "camera.reconnect_s=0.5", "--set", "camera.timeout_s=0.3"]
        options = ["--segmenter", "colour", *MOUNT, *patience]
        assert run(["view", "realsense:", "--save", str(tmp_path / "a.rrd"), *SETTINGS, *options]) == 1
        assert "no image that can be used for" in capsys.readouterr().err
        assert read(tmp_path / "a.rrd")["/world/camera/photo"]["Image:buffer"]
