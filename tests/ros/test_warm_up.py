"""What is slow the first time is done before the first frame."""

import subprocess
import sys
from pathlib import Path

import pytest

from swardmap.config import Config
from swardmap.errors import InputError
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.ros.warm_up import warm_up
from swardmap.types import Frame, Segmentation

SCRIPT = """
import pkgutil, importlib
import swardmap.kernels
from swardmap.config import config_from_dict
from swardmap.models import build_segmenter
from swardmap.ros.parameters import Parameters
from swardmap.ros.live_pipeline import LivePipeline
from swardmap.ros.warm_up import warm_up
from tests.ros.test_live_pipeline import Robot, parameters, pipeline_of, snapshot
from tests.ros import drive

def signatures():
    found = {}
    for info in pkgutil.iter_modules(swardmap.kernels.__path__):
        module = importlib.import_module(f"swardmap.kernels.{info.name}")
        for name, value in vars(module).items():
            dispatcher = getattr(value, "signatures", None)
            if dispatcher is not None:
                found[f"{info.name}.{name}"] = len(dispatcher)
    return found

settings = parameters({"grid": {"mode": MODE}, "geometry": {"enabled": GEOMETRY}})
warm_up(settings.config, build_segmenter(settings.config.segmenter))
before = signatures()
rig = drive.rig_of(drive.ONE)
robot = Robot(pipeline_of(settings, rig), rig)
robot.run([0.0, 0.1, 0.2])
grid = snapshot(robot.pipeline)
robot.pipeline.mapper.costmap(grid)
assert sum(before.values()) > 3, before
assert signatures() == before, (before, signatures())
"""


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "geometry"), [("paper", False), ("evidence", True)])
def test_after_it_no_kernel_is_compiled_for_a_frame(mode: str, geometry: bool) -> None:
    script = SCRIPT.replace("MODE", repr(mode)).replace("GEOMETRY", repr(geometry))
    root = Path(__file__).parent.parent.parent
    subprocess.run([sys.executable, "-c", script], cwd=root, check=True, timeout=250)


def test_a_network_that_cannot_run_is_told_before_the_first_frame() -> None:
    class Broken:
        name, label_set = "broken", GRASS_OBSTACLE_PERSON

        def __call__(self, frame: Frame) -> Segmentation:
            raise InputError("no memory")

    with pytest.raises(InputError, match="no memory"):
        warm_up(Config(), Broken())
