"""A few minutes of damaged files for every reader; hours of it: `make fuzz`."""

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.mutate import mutated

ROOT = Path(__file__).parents[2]


def test_damage_is_the_same_for_the_same_dice_and_seldom_none() -> None:
    content = bytes(range(256)) * 4
    first = [mutated(content, random.Random(n), [content]) for n in range(200)]
    assert first == [mutated(content, random.Random(n), [content]) for n in range(200)]
    assert sum(damaged != content for damaged in first) > 180


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes of POSIX")
def test_no_damage_takes_any_reader_by_surprise(tmp_path: Path) -> None:
    path = os.pathsep.join([str(ROOT), *sys.path])
    command = [sys.executable, "-m", "tests.fuzz.run", "120", "1"]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    failed = [line for line in done.stdout.splitlines() if "no failure" not in line]
    assert done.returncode == 0, "\n".join(failed) + done.stderr[-3000:]
