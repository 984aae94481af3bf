"""The examples run as they stand, without arguments, and say what they should."""

import json
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"
NEEDS_ROS = {"simulated_mower"}


def run_example(name: str) -> None:
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")


@pytest.fixture(autouse=True)
def as_a_user_would(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["example"])


def test_every_example_is_tested() -> None:
    assert {p.stem for p in EXAMPLES.glob("*.py")} == {"bare_arrays", "one_call", "step_by_step"} | NEEDS_ROS


def test_bare_arrays(capsys: pytest.CaptureFixture[str]) -> None:
    run_example("bare_arrays")
    assert "the wall stands at x = 2.55 .. 2.55 m" in capsys.readouterr().out


def test_step_by_step(capsys: pytest.CaptureFixture[str]) -> None:
    run_example("step_by_step")
    out = capsys.readouterr().out
    assert out.count("obstacle cells") == 20
    assert "lethal cells" in out


@pytest.mark.slow
def test_one_call(capsys: pytest.CaptureFixture[str]) -> None:
    run_example("one_call")
    assert "20 frames" in capsys.readouterr().out
    assert Path("out/report.html").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("notebook", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda p: p.stem)
def test_notebooks_run_from_top_to_bottom(notebook: Path) -> None:
    pytest.importorskip("IPython", reason="ipython is not installed")
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    assert all(not cell["outputs"] for cell in cells if cell["cell_type"] == "code"), "clear its outputs"
    program = "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "lethal cells" in done.stdout
