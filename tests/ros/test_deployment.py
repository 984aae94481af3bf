"""Dockerfile, compose file and systemd unit, as far as they can be checked without any of the three."""

import configparser
import importlib
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from swardmap.config import Config
from swardmap.ros.nav2_files import nav2_files
from tests.ros.node_process import ROOT

DOCKER = ROOT / "ros/docker"
DOCKERFILE = (DOCKER / "Dockerfile").read_text(encoding="utf-8")
INSTRUCTIONS = {"ARG", "FROM", "RUN", "COPY", "ENV", "USER", "WORKDIR", "ENTRYPOINT", "CMD"}
FILES = nav2_files(Config())


def instructions() -> list[tuple[str, str]]:
    lines = [line for line in DOCKERFILE.splitlines() if line.strip() and not line.startswith("#")]
    whole = "\n".join(lines).replace("\\\n", " ").splitlines()
    return [(line.split(maxsplit=1)[0], line.split(maxsplit=1)[1]) for line in whole]


def test_the_dockerfile_is_made_of_instructions_and_copies_what_exists() -> None:
    found = instructions()
    assert {name for name, _ in found} <= INSTRUCTIONS
    assert [name for name, _ in found].count("CMD") == 1
    assert found[-1][0] == "CMD"
    for name, rest in found:
        if name == "COPY":
            *sources, _ = [word for word in rest.split() if not word.startswith("--")]
            for source in sources:
                assert (ROOT / source).exists(), source
    assert ":latest" not in DOCKERFILE
    users = [rest for name, rest in found if name == "USER"]
    assert users
    assert users[-1] != "root"


def test_the_packages_of_ros_are_those_of_the_manifest() -> None:
    """What rclpy alone does not bring along."""
    wanted = set(re.findall(r"ros-\$\{ROS_DISTRO\}-([\w-]+)", DOCKERFILE)) - {"foxglove-bridge", "ros-base"}
    manifest = (ROOT / "ros/swardmap_ros/package.xml").read_text()
    for name in wanted:
        assert f"<exec_depend>{name.replace('-', '_')}</exec_depend>" in manifest


def compose() -> dict[str, Any]:
    tree: dict[str, Any] = yaml.safe_load((DOCKER / "compose.yaml").read_text(encoding="utf-8"))
    return tree


def test_the_compose_file_starts_what_there_is() -> None:
    services = compose()["services"]
    build = services["node"]["build"]
    assert (DOCKER / build["context"] / build["dockerfile"]).resolve() == DOCKER / "Dockerfile"
    assert services["node"]["stop_signal"] == "SIGINT"
    for name, service in services.items():
        assert service["network_mode"] == service["ipc"] == "host", name
        for path in re.findall(r"/etc/swardmap/([\w.]+)", str(service)):
            assert path in FILES or path == "gate.yaml", path
        assert set(service.get("depends_on", [])) <= set(services)
    module = services["gate"]["command"][2]
    assert callable(importlib.import_module(module).main)


def unit() -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(ROOT / "ros/systemd/swardmap.service", encoding="utf-8")
    return parser


def test_the_unit_restarts_the_node_and_stops_it_with_its_last_word() -> None:
    service = unit()["Service"]
    assert set(unit().sections()) == {"Unit", "Service", "Install"}
    assert service["Restart"] == "always"
    assert service["KillSignal"] == "SIGINT"
    assert service["ExecStart"].startswith("/")
    assert "swardmap ros --params" in service["ExecStart"]
    assert service["User"] != "root"
    assert Path(service["WorkingDirectory"]).name == service["StateDirectory"]  # systemd makes it


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd here")
def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    text = (ROOT / "ros/systemd/swardmap.service").read_text().replace("User=mower", "User=root")
    (tmp_path / "swardmap.service").write_text(text)
    command = ["systemd-analyze", "verify", str(tmp_path / "swardmap.service")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert "Unknown" not in done.stderr
    assert "Failed to parse" not in done.stderr


def has_compose() -> bool:
    if shutil.which("docker") is None:
        return False
    return subprocess.run(["docker", "compose", "version"], check=False, capture_output=True).returncode == 0


@pytest.mark.skipif(not has_compose(), reason="there is no docker compose here")
def test_docker_takes_the_compose_file() -> None:
    command = ["docker", "compose", "-f", str(DOCKER / "compose.yaml"), "config", "--quiet"]
    subprocess.run(command, check=True, timeout=60)


def test_the_entry_point_is_a_script_that_hands_over() -> None:
    script = DOCKER / "entrypoint.sh"
    subprocess.run(["bash", "-n", str(script)], check=True)
    assert script.read_text().rstrip().endswith('exec "$@"')
