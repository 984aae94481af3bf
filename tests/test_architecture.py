"""The house rules that a reader relies on: who imports whom, and what an import costs."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import swardmap

SOURCE = Path(swardmap.__file__).parent
ROOT = Path(__file__).parent.parent
CORE = (
    "errors",
    "labels",
    "geometry",
    "types",
    "settings",
    "config",
    "cloud",
    "grid",
    "ground",
    "ground_fit",
    "mapper",
    "evidence",
    "living",
    "roads",
    "costmap",
    "level",
    "pipeline",
    "rig",
    "travel",
    "health",
    "camera_watch",
    "watchdog",
    "freshness",
    "gps",
    "work_area",
)
EDGES = ("io", "models", "eval", "synth", "train", "viz", "ros", "cli", "recording")
HEAVY = (
    "numba",
    "cv2",
    "onnxruntime",
    "scipy",
    "rosbags",
    "torch",
    "rich",
    "typer",
    "yaml",
    "sklearn",
    "ray",
    "rclpy",
    "moderngl",
    "rerun",
    "pyproj",
)


def imported_modules(file: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def test_importing_swardmap_loads_nothing_heavy() -> None:
    core = ", ".join(f"swardmap.{name}" for name in CORE)
    code = f"import swardmap, {core}, sys; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", CORE)
def test_the_core_never_imports_the_edges(name: str) -> None:
    edges = {f"swardmap.{edge}" for edge in EDGES}
    found = {m for m in imported_modules(SOURCE / f"{name}.py") if ".".join(m.split(".")[:2]) in edges}
    assert not found


def test_only_the_kernels_import_numba() -> None:
    users = {
        str(file.relative_to(SOURCE))
        for file in SOURCE.rglob("*.py")
        if any(m.split(".")[0] == "numba" for m in imported_modules(file))
    }
    assert users
    assert all(user.startswith("kernels/") for user in users)


def test_only_training_imports_torch() -> None:
    users = [
        file
        for file in SOURCE.rglob("*.py")
        if any(m.split(".")[0] == "torch" for m in imported_modules(file))
    ]
    assert all(file.is_relative_to(SOURCE / "train") for file in users)


def test_every_extra_named_in_a_message_exists() -> None:
    extras = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])
    for file in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if (
                isinstance(node, ast.Call)
                and getattr(node.func, "id", "") == "require"
                and len(node.args) > 1
            ):
                extra = node.args[1]
                assert isinstance(extra, ast.Constant)
                assert extra.value in extras, f"{file}: extra {extra.value!r} is not in pyproject.toml"


def test_nothing_unpickles_or_evaluates() -> None:
    for file in SOURCE.rglob("*.py"):
        names = imported_modules(file)
        assert not names & {"pickle", "dill", "joblib", "shelve", "marshal"}, file
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                assert called not in {"eval", "exec", "yaml.load", "yaml.unsafe_load"}, f"{file}: {called}"
                if called in {"np.load", "torch.load"}:
                    safe = {"allow_pickle": False, "weights_only": True}
                    given = {k.arg: ast.literal_eval(k.value) for k in node.keywords if k.arg in safe}
                    assert any(given.get(key) is value for key, value in safe.items()), f"{file}: {called}"


def test_version_is_in_the_changelog() -> None:
    assert f"[{swardmap.__version__}]" in (ROOT / "CHANGELOG.md").read_text()
