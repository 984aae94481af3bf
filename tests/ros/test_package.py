"""The colcon package: what it declares is true, it builds, and its launch file starts the node."""

import ast
import importlib
import os
import re
import shutil
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

import swardmap
from tests.ros.node_process import ROOT, environment, program

PACKAGE = ROOT / "ros" / "swardmap_ros"
OPTIONAL_MODULES = re.compile(r'"(\w+)\.(?:msg|srv):')


def entry_points() -> dict[str, str]:
    text = (PACKAGE / "setup.py").read_text()
    return dict(re.findall(r'"(\w+) = ([\w.]+:\w+)"', text))


def test_the_manifest_is_that_of_an_ament_python_package() -> None:
    root = ET.parse(PACKAGE / "package.xml").getroot()  # noqa: S314 - our own file
    assert (root.tag, root.get("format")) == ("package", "3")
    assert root.findtext("name") == "swardmap_ros"
    assert root.findtext("version") == swardmap.__version__
    assert root.findtext("license") == "Apache-2.0"
    assert root.findtext("export/build_type") == "ament_python"


def test_the_manifest_names_every_ros_package_that_is_imported() -> None:
    imported: set[str] = set()
    for file in [*(ROOT / "src/swardmap/ros").glob("*.py"), *(PACKAGE / "launch").glob("*.py")]:
        text = file.read_text()
        imported |= set(OPTIONAL_MODULES.findall(text))
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and node.module:
                imported.add(node.module.split(".")[0])
    ros = {name for name in imported if name.endswith(("_msgs", "_srvs", "_interfaces")) or "launch" in name}
    root = ET.parse(PACKAGE / "package.xml").getroot()  # noqa: S314 - our own file
    declared = {element.text for element in root.findall("exec_depend")}
    assert ros | {"rclpy"} <= declared


def test_setup_tells_the_version(tmp_path: Path) -> None:
    shutil.copytree(PACKAGE, tmp_path / "package")
    command = [sys.executable, "setup.py", "--version"]
    done = subprocess.run(command, cwd=tmp_path / "package", check=True, capture_output=True, text=True)
    assert done.stdout.strip() == swardmap.__version__


def test_entry_points_and_data_files_exist() -> None:
    assert set(entry_points()) == {"swardmap", "gate"}
    for target in entry_points().values():
        module, _, name = target.partition(":")
        assert callable(getattr(importlib.import_module(module), name))
    for path in re.findall(r'\["((?:launch|package)[\w./]+)"\]', (PACKAGE / "setup.py").read_text()):
        assert (PACKAGE / path).is_file(), path
    assert (PACKAGE / "resource" / "swardmap_ros").is_file()


def test_the_arguments_of_the_launch_file_are_described() -> None:
    tree = ast.parse((PACKAGE / "launch/swardmap.launch.py").read_text())
    (arguments,) = (
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "ARGUMENTS"
    )
    page = (ROOT / "docs/robot.md").read_text()
    for name in ast.literal_eval(arguments):
        assert f"`{name}" in page, name


def built(folder: Path) -> Path:
    """The package, built by colcon into a workspace."""
    if find_spec("colcon") is None:
        pytest.skip("colcon is not installed (pip install colcon-ros)")
    (folder / "src").mkdir()
    shutil.copytree(PACKAGE, folder / "src" / "swardmap_ros")
    command = [sys.executable, "-m", "colcon", "build"]
    subprocess.run(command, cwd=folder, check=True, timeout=250, stdout=subprocess.DEVNULL)
    return folder / "install" / "swardmap_ros"


@pytest.mark.slow
def test_colcon_builds_it_and_its_executables_run(tmp_path: Path) -> None:
    pytest.importorskip("rclpy", reason="rclpy is not installed (pip install 'swardmap[ros]')")
    prefix = built(tmp_path)
    assert (prefix / "share/swardmap_ros/launch/swardmap.launch.py").is_file()
    assert (prefix / "share/ament_index/resource_index/packages/swardmap_ros").is_file()
    for name in entry_points():  # each says in one line that there is no such parameter file
        file = prefix / "lib/swardmap_ros" / name
        command = [str(file), "--ros-args", "--params-file", "nowhere.yaml"]
        env = environment() | {"PYTHONPATH": os.pathsep.join(python_path(prefix))}
        done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=100)
        assert done.returncode == 1
        assert "\nswardmap: ROS arguments: " in done.stderr, done.stderr
        assert "Traceback" not in done.stderr


def python_path(prefix: Path) -> list[str]:
    (site,) = prefix.glob("lib/python*/site-packages")
    return [str(site), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]


LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

file, *arguments = sys.argv[1:]
given = [tuple(argument.split(":=", 1)) for argument in arguments]
service = LaunchService(noninteractive=True)
service.include_launch_description(LaunchDescription(
    [IncludeLaunchDescription(PythonLaunchDescriptionSource(file), launch_arguments=given)]
))
sys.exit(service.run())
"""


@pytest.mark.slow
def test_the_launch_file_starts_node_and_gate_in_a_namespace(tmp_path: Path) -> None:
    """As `ros2 launch` does it: the real launch and launch_ros, where a ROS has them."""
    if find_spec("rclpy") is None or find_spec("launch_ros") is None:
        pytest.skip("launch_ros has no wheel; this ROS lacks it")
    prefix = built(tmp_path)
    params = tmp_path / "params.yaml"
    params.write_text("/**: {ros__parameters: {segmenter: {name: colour}, cloud: {max_range_m: 6.5}}}")
    file = prefix / "share/swardmap_ros/launch/swardmap.launch.py"
    given = ["namespace:=mower", f"params:={params}", "gate:=true", "autostart:=false"]
    paths = [str(prefix), *filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))]
    env = environment() | {
        "AMENT_PREFIX_PATH": os.pathsep.join(paths), "PYTHONPATH": os.pathsep.join(python_path(prefix)),
    }  # fmt: skip
    with subprocess.Popen([sys.executable, "-c", LAUNCH, str(file), *given], env=env) as process:
        try:
            questions = '[["state"], ["get", "cloud.max_range_m"], ["nodes", "swardmap", "swardmap_gate"]]'
            answers: list[Any] = ast.literal_eval(program("ask", "/mower", questions))
        finally:
            process.send_signal(signal.SIGINT)  # launch stops what it started, as after Ctrl-C
            process.wait(timeout=60)
    assert answers[:2] == ["unconfigured", 6.5]
    assert {"/mower/swardmap", "/mower/swardmap_gate"} <= set(answers[2])
