"""The gate itself is tested: skipped tests, foreign plugins and our own warnings do what they should."""

import subprocess
import sys
import tomllib
import warnings
from pathlib import Path

import pytest
import yaml

import swardmap

ROOT = Path(__file__).parent.parent
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())

FOREIGN_PLUGIN = """
import warnings
import pytest

warnings.warn("old at import", DeprecationWarning)


@pytest.mark.tryfirst  # old style: pytest warns of it
def pytest_configure(config):
    warnings.warn("old when configured", DeprecationWarning)


@pytest.fixture(autouse=True)
def _around_each():
    warnings.warn("old around each test", FutureWarning)
    yield
"""


def run_pytest(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Pytest with this repository's settings and no test of it, beside what `folder` holds."""
    program = (
        f"import sys; sys.path[:0] = [{str(folder)!r}, {str(ROOT)!r}]; "
        f"import pytest; sys.exit(pytest.main({['-c', str(ROOT / 'pyproject.toml'), *arguments]!r}))"
    )
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=folder)


def test_plugins_of_other_packages_do_not_stop_a_run(tmp_path: Path) -> None:
    (tmp_path / "foreign.py").write_text(FOREIGN_PLUGIN)
    about = tmp_path / "foreign-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[pytest11]\nforeign = foreign\n")
    (tmp_path / "test_one.py").write_text("def test_one():\n    pass\n")
    done = run_pytest(tmp_path, "test_one.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "old when configured" in done.stdout + done.stderr, "the plugin was not loaded"


@pytest.mark.parametrize("module", ["swardmap.grid", "tests.test_grid", "numpy.lib", "scipy.ndimage"])
def test_warnings_of_ours_are_errors(module: str) -> None:
    with pytest.raises(DeprecationWarning):
        warnings.warn_explicit("old", DeprecationWarning, "a.py", 1, module=module, registry={})


@pytest.mark.parametrize(("least", "status"), [(1, 0), (2, 1)])
@pytest.mark.parametrize("workers", [(), ("-n", "1")])
def test_a_run_that_skips_too_much_is_red(
    least: int, status: int, workers: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "test_two.py").write_text(
        "import pytest\n\ndef test_runs():\n    pass\n\ndef test_skips():\n    pytest.skip('no camera')\n"
    )
    done = run_pytest(tmp_path, "-p", "tests.floor", "--least-executed", str(least), *workers, "test_two.py")
    assert done.returncode == status, done.stdout + done.stderr
    assert "1 tests executed" in done.stdout


def test_ci_holds_both_floors() -> None:
    ci = (ROOT / ".ci/run").read_text()
    assert "make coverage" in ci
    makefile = (ROOT / "Makefile").read_text()
    assert "--least-executed" in makefile
    assert PYPROJECT["tool"]["coverage"]["report"]["fail_under"] >= 85


def test_declared_versions_of_python_agree() -> None:
    declared = {
        c.rsplit(" ", 1)[1]
        for c in PYPROJECT["project"]["classifiers"]
        if c.startswith("Programming Language :: Python :: 3.")
    }
    assert declared == {"3.11", "3.12", "3.13"}
    assert f"{sys.version_info.major}.{sys.version_info.minor}" in declared


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    assert citation["version"] == swardmap.__version__
    assert citation["license"] == PYPROJECT["project"]["license"]
    assert citation["preferred-citation"]["doi"] == "10.3390/s21165292"


def test_hooks_run_the_versions_that_ci_runs() -> None:
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())
    local = {hook["id"]: hook for repo in hooks["repos"] if repo["repo"] == "local" for hook in repo["hooks"]}
    assert {"ruff-check", "ruff-format", "mypy"} <= set(local)


def test_the_site_shows_every_page() -> None:
    nav = (ROOT / "mkdocs.yml").read_text()
    for page in (ROOT / "docs").rglob("*.md"):
        assert f" {page.relative_to(ROOT / 'docs').as_posix()}\n" in nav


@pytest.mark.parametrize("workflow", sorted((ROOT / ".github/workflows").glob("*.yml")), ids=lambda p: p.stem)
def test_workflows_call_what_is_there(workflow: Path) -> None:
    jobs = yaml.safe_load(workflow.read_text())["jobs"]
    runs = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    makefile = (ROOT / "Makefile").read_text()
    assert runs
    for run in runs:
        program, *words = run.split()
        if program == "make":
            assert f"\n{words[0]}:" in makefile, run
        elif program == "python":
            assert (ROOT / words[0]).is_file(), run
    versions = {
        v for job in jobs.values() for v in job.get("strategy", {}).get("matrix", {}).get("python", [])
    }
    assert versions in (set(), {"3.11", "3.12", "3.13"})


def test_release_notes_are_the_words_of_the_changelog() -> None:
    command = [sys.executable, "tools/release_notes.py"]
    done = subprocess.run(
        [*command, swardmap.__version__], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip()
    assert done.stdout.strip() in (ROOT / "CHANGELOG.md").read_text()
    assert "## [" not in done.stdout
    wrong = subprocess.run([*command, "9.9.9"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert wrong.returncode == 1
    assert f"expected the tag v{swardmap.__version__}" in wrong.stderr
