"""The examples run as they stand, and say what they should."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


def test_bare_arrays(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(EXAMPLES / "bare_arrays.py"), run_name="__main__")
    assert "the wall stands at x = 2.55 .. 2.55 m" in capsys.readouterr().out


def test_step_by_step(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(EXAMPLES / "step_by_step.py"), run_name="__main__")
    out = capsys.readouterr().out
    assert out.count("obstacle cells") == 5
    assert "lethal cells" in out
