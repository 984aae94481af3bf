"""The standard output may be full, closed or read by nobody; messages are one line of bounded length."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from swardmap.cli.app import run
from swardmap.geometry import Intrinsics
from swardmap.io.sources.folder import write_folder
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses

SWARDMAP = [sys.executable, "-m", "swardmap"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_output_is_one_line_and_exit_code_1() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*SWARDMAP, "config"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 1
    assert done.stderr == "swardmap: cannot write to the standard output: No space left on device\n"


def test_an_output_that_nobody_reads_to_its_end_is_no_error() -> None:
    with subprocess.Popen([*SWARDMAP, "config"], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        assert running.stdout is not None
        running.stdout.close()
        assert running.wait(60) == 0
        assert running.stderr is not None
        assert running.stderr.read() == b""


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_closed_outputs_are_no_error(closed: str) -> None:
    done = subprocess.run(["sh", "-c", f"'{sys.executable}' -m swardmap config {closed}"], check=False)
    assert done.returncode == 0


@pytest.mark.parametrize("text", ["x" * 20_000, "a\nb" * 3000, "\x1b[2J" * 100])
def test_messages_echo_no_blobs(text: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(f"grid: {{resolution_m: {text!r}}}")
    for command in (["--set", f"grid.mode={text}"], ["--set", text], ["-c", str(tmp_path / "c.yaml")]):
        assert run(["config", *command]) == 1
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert len(said) <= 320
        assert said.rstrip("\n").isprintable()


@pytest.mark.slow
def test_ctrl_c_while_workers_start_says_one_line(tmp_path: Path) -> None:
    lens = Intrinsics(96, 72, 80.0, 80.0, 47.5, 35.5)
    write_folder(AnalyticSource(garden_scene(0), tuple(lane_poses(40, step_m=0.1)), lens), tmp_path / "rec")
    command = [*SWARDMAP, "evaluate", str(tmp_path / "rec"), "--segmenter", "truth", "--workers", "2"]
    subprocess.run([*command, "-o", str(tmp_path / "warm")], check=True, capture_output=True)  # compile
    for delay_s in (0.0, 0.3, 0.8):
        out = tmp_path / f"out{delay_s}"
        running = subprocess.Popen(
            [*command, "-o", str(out)],
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )
        while not (out / "plan.json").exists():
            assert running.poll() is None
            time.sleep(0.02)
        time.sleep(delay_s)
        os.killpg(running.pid, signal.SIGINT)  # as a terminal does: to all of them
        _, said = running.communicate(timeout=60)
        assert [line for line in said.splitlines() if not line.startswith("evaluated")] == [
            "swardmap: interrupted"
        ]
        assert running.returncode == 130
