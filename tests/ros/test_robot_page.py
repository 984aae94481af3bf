"""docs/robot.md and docs/watchdog.md say what the code says: topics, parameters, faults, reasons."""

import dataclasses
import os
import re
import shlex
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from swardmap.monitor.diagnostics import WARNINGS, Fault
from swardmap.ros import inputs, intake, watched_mapper
from swardmap.ros.gate import GateConfig
from swardmap.ros.map_outputs import OF_MAP
from swardmap.ros.outputs import OF_CAMERA, OF_NODE
from swardmap.ros.parameters import NodeConfig
from tests.ros.node_process import ROOT, environment

PAGE = (ROOT / "docs/robot.md").read_text(encoding="utf-8")
WATCHDOG = (ROOT / "docs/watchdog.md").read_text(encoding="utf-8")


def rows(title: str, page: str = PAGE) -> list[list[str]]:
    """The tables of a section, without their heads."""
    section = page.split(f"\n## {title}\n")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip().removesuffix("|")[1:].split("|")] for line in lines]


def names(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def test_topics_are_those_of_the_node_with_their_types() -> None:
    told: dict[str, str] = {}
    last = ""
    for cells in rows("Topics, services, states"):
        if len(cells) != 3 or cells[0] == "topic":
            continue
        last = last if cells[1] == "the same" else cells[1]
        types = re.findall(r"\w+_msgs/\w+", last)
        for i, topic in enumerate(names(cells[0])):
            told[topic] = types[min(i, len(types) - 1)]
    expected = {f"CAMERA/{name}": kind for name, kind in OF_CAMERA.items()} | dict(OF_NODE) | dict(OF_MAP)
    expected["/diagnostics"] = "diagnostic_msgs/msg/DiagnosticArray"
    assert told == {name: kind.replace("/msg/", "/") for name, kind in expected.items()}


def test_parameters_of_the_node_are_told_with_their_defaults() -> None:
    told: dict[str, str] = {}
    for cells in rows("Parameters"):
        values = [value.strip("` ") for value in cells[1].split(",")]
        for i, name in enumerate(names(cells[0])):
            told[name] = values[min(i, len(values) - 1)]
    defaults = {f.name: f.default for f in dataclasses.fields(NodeConfig)}
    assert set(told) == set(defaults)
    for name, value in told.items():
        default = defaults[name]
        plain = "" if default is None else str(default).lower() if isinstance(default, bool) else f"{default}"
        assert value in (plain, plain.removesuffix(".0")), name


def test_parameters_of_the_gate_are_told() -> None:
    told = {name for cells in rows("5. Stop for a person") for name in names(cells[0])}
    assert told >= {f.name for f in dataclasses.fields(GateConfig)} | {"stamped"}


@pytest.mark.parametrize("fault", list(Fault))
def test_every_fault_is_described_with_its_severity(fault: Fault) -> None:
    told = {cells[0]: cells[-1] for cells in rows("What it names", WATCHDOG)}
    assert told[fault] == ("warn" if fault in WARNINGS else "stop")


def test_the_reasons_that_are_explained_are_given() -> None:
    given = {
        value
        for module in (inputs, intake, watched_mapper)
        for name, value in vars(module).items()
        if name.startswith("REASON_")
    } | {f"{fault}" for fault in Fault}
    for cells in rows("When something is wrong")[1:]:
        for reason in names(cells[0]):
            assert reason in given, reason


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.skipif(find_spec("rclpy") is None, reason="rclpy is not installed (pip install 'swardmap[ros]')")
def test_the_node_starts_as_the_page_by_task_says(tmp_path: Path) -> None:
    page = (ROOT / "docs/tasks/robot.md").read_text(encoding="utf-8")
    install, write_files, start = re.findall(r"```console\n(.*?)```", page, re.DOTALL)[0].splitlines()
    assert install.startswith("pip install ")  # what it names is checked in tests/test_tasks.py
    home = environment() | {"HOME": str(tmp_path)}

    def as_shown(command: str) -> list[str]:
        python = shlex.quote(sys.executable)
        return ["bash", "-c", command.replace("swardmap ", f"exec {python} -m swardmap ", 1)]

    subprocess.run(as_shown(write_files), env=home, cwd=tmp_path, check=True)
    with subprocess.Popen(
        as_shown(start), env=home, cwd=tmp_path, stderr=subprocess.PIPE, text=True, bufsize=1
    ) as node:
        assert node.stderr is not None
        said = []
        for line in node.stderr:
            said.append(line)
            if "stop: " in line or " ERROR" in line:
                break
        os.kill(node.pid, signal.SIGINT)
        said += node.stderr.readlines()
        assert node.wait(timeout=60) == 0, "".join(said)
    assert any("stop: " in line for line in said), "".join(said)
