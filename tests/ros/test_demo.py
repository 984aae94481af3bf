"""`swardmap ros --demo` over real DDS: a mower drives, stands for a person, goes around a bed, comes back.

In a garden of simple solids, and in one that is rendered and seen by the network of the package.
The start area is not granted by the node itself here: the mower's operator has to ask for it.
"""

import importlib.util
import json
import math
import subprocess
import sys
import uuid
from pathlib import Path
from typing import Any

import pytest

from swardmap.cli.ros_demo import RENDERED, SOLIDS, garden_kind
from swardmap.errors import SwardmapError
from swardmap.synth.live_garden import BED_HALF_M, BED_M, GOAL_M, Visit
from tests.ros.node_process import environment, program

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("rclpy is not installed (pip install 'swardmap[ros]')", allow_module_level=True)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

FAST = "4"
"""Of its own clock, which waits for the node where the machine is slower."""


@pytest.fixture(scope="module", params=[SOLIDS, RENDERED])
def told(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """What the mower says of itself at each tenth of a second of its clock, over one round."""
    try:
        garden_kind(request.param)
    except SwardmapError as error:
        pytest.skip(f"nothing draws the rendered garden: {error}")
    folder, namespace = tmp_path_factory.mktemp("demo"), f"/d{uuid.uuid4().hex[:8]}"
    command = [sys.executable, "-m", "swardmap", "ros", "--demo", "--garden", request.param, "--rounds", "1"]
    command += ["--pace", FAST, "--", "-r", f"__ns:={namespace}"]
    command += ["-p", "start_area_at_start:=false"]
    with subprocess.Popen(command, env=environment(), cwd=folder) as process:
        try:
            program("status_log", namespace, str(folder / "told.json"), timeout_s=1000)
            assert process.wait(timeout=100) == 0
        finally:
            if process.poll() is None:
                process.terminate()
    lines: list[dict[str, Any]] = json.loads(Path(folder / "told.json").read_text(encoding="utf-8"))
    return lines


def test_it_sets_out_once_the_service_has_granted_a_start_area(told: list[dict[str, Any]]) -> None:
    """In whatever order the programs discover each other: nothing here must be heard before anything else."""
    moved = [t for t in told if t["place"] != [0, 0, 0]]
    assert moved
    assert all(t["start_areas"] >= 1 for t in moved)


def test_it_goes_there_and_comes_back(told: list[dict[str, Any]]) -> None:
    assert min(math.dist(t["place"][:2], GOAL_M) for t in told) < 0.65
    assert told[-1]["rounds"] == 1
    assert math.dist(told[-1]["place"][:2], (0, 0)) < 0.65


def test_it_stands_for_the_person_who_walks_in_and_goes_on(told: list[dict[str, Any]]) -> None:
    stands = [i for i, t in enumerate(told) if t["reason"].startswith("a person")]
    assert len(stands) >= 5  # half a second
    assert min(math.dist(t["place"][:2], t["person_m"]) for t in told) > 0.7
    in_lane = [t for t in told if math.dist(t["person_m"], Visit().lane_m) < 1e-6]
    assert len(in_lane) > 10
    assert len({tuple(t["place"]) for t in in_lane[5:]}) == 1  # not a step while they stand there
    assert any(not t["reason"] for t in told[stands[-1] :])


def test_it_goes_around_the_bed(told: list[dict[str, Any]]) -> None:
    for t in told:
        x, y, _ = t["place"]
        away = (max(abs(x - BED_M[0]) - BED_HALF_M[0], 0), max(abs(y - BED_M[1]) - BED_HALF_M[1], 0))
        assert math.hypot(*away) > 0.45  # what turning sweeps
    beside = [t["place"][1] for t in told if abs(t["place"][0] - BED_M[0]) < 0.3]
    assert beside
    assert min(map(abs, beside)) > BED_HALF_M[1] + 0.45
