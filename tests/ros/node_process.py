"""The node as a process of its own, started as a user starts it, and the programs that talk to it."""

import json
import os
import signal
import subprocess
import sys
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
ROOT = HERE.parent.parent

RELIABLY = {"queue_frames": 100, "image_reliability": "reliable", "image_depth": 50, "map_rate_hz": 20.0,
            "cloud_stride": 1, "pose_wait_ms": 5000.0}  # fmt: skip
"""Nothing is lost, so that what comes can be compared with what was sent: not even an image whose pose,
sent at the same time, is heard late on a busy machine."""


def environment() -> dict[str, str]:
    # a domain for each worker; a namespace for each test besides, since others may use this machine
    domain = 1 + (os.getpid() % 99)
    return os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(domain)}


def program(name: str, *arguments: str, timeout_s: float = 400) -> str:
    """Run one of the programs beside this file to its end; what it printed."""
    command = [sys.executable, "-m", f"tests.ros.{name}", *arguments]
    done = subprocess.run(
        command, env=environment(), cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True, timeout=timeout_s
    )
    return done.stdout


@dataclass
class Robot:
    """A running node, and the programs that talk to it."""

    process: "subprocess.Popen[str]"
    namespace: str
    folder: Path

    def play(self, bag: Path, *options: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Arrays by name, and what was told, of all outputs while a recording was played."""
        out = self.folder / f"{uuid.uuid4().hex}.npz"
        program("player", str(bag), str(out), self.namespace, *options)
        with np.load(out, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        return arrays, json.loads(str(arrays.pop("told")))

    def ask(self, *questions: list[Any]) -> list[Any]:
        answers: list[Any] = json.loads(program("ask", self.namespace, json.dumps(questions)))
        return answers

    def inject(self, *faults: str) -> dict[str, Any]:
        """What happened at each fault, by its name."""
        out = self.folder / f"{uuid.uuid4().hex}.json"
        program("faults", str(out), self.namespace, str(self.process.pid), *faults, timeout_s=1500)
        if "terminated" in faults:
            self.process.wait(timeout=60)
        told: dict[str, Any] = json.loads(out.read_text())
        return told

    def kill(self) -> None:
        """As the kernel does when memory is short: it has no last word."""
        self.process.kill()
        self.process.wait(timeout=30)


@contextmanager
def running(folder: Path, settings: dict[str, Any], node: dict[str, Any]) -> Iterator[Robot]:
    """The node, started as a user starts it: `swardmap ros --params FILE`, here in a namespace."""
    namespace = f"/t{uuid.uuid4().hex[:8]}"
    file = folder / f"{namespace[1:]}.yaml"
    # ROS parameters are YAML, and so is JSON
    file.write_text(json.dumps({"/**": {"ros__parameters": node | settings}}))
    command = [sys.executable, "-m", "swardmap", "ros", "--params", str(file)]
    remapped = ["--", "-r", f"__ns:={namespace}", "-r", "/odom:=odom", "-r", "/tf:=tf"]
    remapped += ["-r", "/tf_static:=tf_static"]
    with subprocess.Popen([*command, *remapped], env=environment(), text=True, cwd=folder) as process:
        try:
            yield Robot(process, namespace, folder)
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            assert process.wait(timeout=60) in (0, -signal.SIGKILL)
