"""`swardmap doctor`: what is missing is named with what installs it, and does not hide the rest."""

import json
import platform
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from swardmap.cli import doctor
from swardmap.cli.app import run
from swardmap.runs.speed import Speed


def told(capsys: pytest.CaptureFixture[str], code: int = 0) -> dict[str, dict[str, Any]]:
    assert run(["doctor", "--json", "--seconds", "0"]) == code
    rows: dict[str, dict[str, Any]] = json.loads(capsys.readouterr().out)
    return rows


@pytest.mark.parametrize(
    ("row", "module", "extra"),
    [("realsense camera", "pyrealsense2", "realsense"), ("rerun viewer", "rerun", "view"),
     ("work area (gps)", "pyproj", "gps"), ("garden renderer", "moderngl", "synth"),
     ("training", "torch", "train"), ("cluster", "ray", "ray"), ("ros 2", "rclpy", "ros")],
)  # fmt: skip
def test_a_missing_extra_is_named_with_its_command(
    row: str, module: str, extra: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr(doctor, "OPTIONAL", {row: doctor.OPTIONAL[row]})
    found = told(capsys)[row]
    assert not found["works"]
    assert f"pip install 'swardmap[{extra}]'" in found["about"]


def test_the_garden_renderer_names_its_driver(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    moderngl = pytest.importorskip("moderngl")
    monkeypatch.setattr(doctor, "OPTIONAL", {"it": doctor.OPTIONAL["garden renderer"]})

    def no_driver(**_: object) -> None:
        raise OSError("libEGL.so.1: cannot open shared object file")

    monkeypatch.setattr(moderngl, "create_context", no_driver)
    about = told(capsys)["it"]["about"]
    assert "libEGL.so.1" in about
    assert "apt-get install libegl1" in about


def test_garden_assets_are_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "OPTIONAL", {"it": doctor.OPTIONAL["garden assets"]})
    monkeypatch.setenv("SWARDMAP_GARDEN_ASSETS", str(tmp_path))
    found = told(capsys)["it"]
    assert not found["works"]
    assert str(tmp_path) in found["about"]
    assert "pip install" in found["about"]


def test_a_screen_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun")
    monkeypatch.setattr(doctor, "OPTIONAL", {"it": doctor.OPTIONAL["rerun viewer"]})
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    for display, words in (("", "no screen"), (":0", "a screen")):
        monkeypatch.setenv("DISPLAY", display)
        assert words in told(capsys)["it"]["about"]


def test_what_everybody_needs_decides_the_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken() -> str:
        raise RuntimeError("a compiled kernel gave 2\nand more")

    monkeypatch.setattr(doctor, "NEEDED", {"kernels": broken, "python": doctor.NEEDED["python"]})
    monkeypatch.setattr(doctor, "OPTIONAL", {})
    rows = told(capsys, code=1)
    assert rows["kernels"] == {"works": False, "about": "a compiled kernel gave 2"}
    assert rows["python"]["works"]
    assert run(["doctor"]) == 1
    assert "--  kernels            a compiled kernel gave 2\n" in capsys.readouterr().out


def speed(frames_per_s: float, threads: int = 1, provider: str = "CPUExecutionProvider") -> Speed:
    return Speed(threads, provider, frames_per_s, 40.0, 2.0)


def test_more_threads_are_advised_where_they_were_faster(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    advice = doctor.faster([speed(20.0), speed(30.0, threads=2)])
    assert advice[0] == "faster: --set segmenter.threads=2 (1.5 times as fast, while nothing else runs)"
    assert len(doctor.faster([speed(20.0), speed(20.5, threads=2)])) == 1
    with_cuda = doctor.faster([speed(20.0), speed(200.0, provider="CUDAExecutionProvider")])
    assert "--set segmenter.provider=CUDAExecutionProvider (10.0" in with_cuda[0]


def test_providers_that_this_machine_could_have_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert "onnxruntime-openvino" in doctor.faster([speed(20.0)])[0]
    monkeypatch.setattr(shutil, "which", lambda _: "/usr/bin/nvidia-smi")
    assert "onnxruntime-gpu" in doctor.faster([speed(20.0)])[0]


@pytest.mark.slow
def test_the_speed_of_this_machine_is_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "OPTIONAL", {})
    assert run(["doctor", "--seconds", "0.5"]) == 0
    assert re.search(r"\d frames/s, network \d+ ms with 1 thread, map \d+\.\d ms", capsys.readouterr().out)
