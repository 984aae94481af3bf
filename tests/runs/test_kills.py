"""Verbs that are killed at their calls to the file system; see `kills`."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
VERBS = (
    "map",
    "map_over",
    "map_living",
    "evaluate",
    "evaluate_over",
    "record",
    "record_over",
    "synth",
    "synth_over",
    "node_save",
    "train",
)
EVERY = {"record": 1, "record_over": 1, "node_save": 9, "synth": 19, "synth_over": 19}
"""Calls from one kill to the next, else 9; `python -m tests.runs.kills` takes any."""
pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes of POSIX")


def killed(verb: str, folder: Path, every: int) -> list[str]:
    command = [sys.executable, "-m", "tests.runs.kills", str(folder), str(every), verb]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.splitlines()


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("verb", VERBS)
def test_killed_at_its_calls_a_verb_leaves_old_or_new_or_a_plan(verb: str, tmp_path: Path) -> None:
    _, row = killed(verb, tmp_path, EVERY.get(verb, 9))
    assert int(row.split("|")[2]) > 2


@pytest.mark.parametrize("verb", ["map_over", "evaluate_over", "record_over"])
def test_killed_at_some_calls_a_verb_leaves_old_or_new_or_a_plan(verb: str, tmp_path: Path) -> None:
    killed(verb, tmp_path, 9)
