"""A minute of damaged files for all readers; half an hour and more of it: `make fuzz`."""

import math
import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.fuzz.mutate import mutated
from tests.fuzz.readers import Reader
from tests.fuzz.run import failure_of

ROOT = Path(__file__).parents[2]


def test_damage_is_the_same_for_the_same_dice_and_seldom_none() -> None:
    content = bytes(range(256)) * 4
    first = [mutated(content, random.Random(n), [content]) for n in range(200)]
    assert first == [mutated(content, random.Random(n), [content]) for n in range(200)]
    assert sum(damaged != content for damaged in first) > 180


def computes(_: Path) -> None:
    while True:
        math.isqrt(10**200)


def waits(_: Path) -> None:
    while True:
        time.sleep(0.05)


def test_a_reader_that_computes_or_waits_too_long_is_a_failure(tmp_path: Path) -> None:
    limits = "more than 0.05 s of the processor or 0.6 s in test_fuzz.py"
    for endless in (computes, waits):
        assert failure_of(Reader(endless, ()), tmp_path, 0.05).startswith(limits)


def test_a_reader_that_a_busy_machine_holds_up_is_none(tmp_path: Path) -> None:
    def held_up(_: Path) -> None:
        time.sleep(0.3)  # six times the time of the processor that it may take

    def once(_: Path) -> None:
        if not (tmp_path / "seen").exists():
            (tmp_path / "seen").touch()
            computes(tmp_path)

    assert failure_of(Reader(held_up, ()), tmp_path, 0.05) == ""
    assert failure_of(Reader(once, ()), tmp_path, 0.05) == ""


def test_what_is_raised_is_told_with_its_place(tmp_path: Path) -> None:
    def wrong(_: Path) -> None:
        raise ZeroDivisionError("of nothing")

    told = failure_of(Reader(wrong, ()), tmp_path)
    assert told.startswith("ZeroDivisionError test_fuzz.py:")
    assert told.endswith(": of nothing")


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes of POSIX")
def test_no_damage_takes_any_reader_by_surprise(tmp_path: Path) -> None:
    path = os.pathsep.join([str(ROOT), *sys.path])
    command = [sys.executable, "-m", "tests.fuzz.run", "60", "1"]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    failed = [line for line in done.stdout.splitlines() if "no failure" not in line]
    if done.returncode != 0:
        pytest.fail("\n".join([*failed, done.stderr[-3000:]]), pytrace=False)  # short: logs are cut
