"""The house rules that a reader relies on: who imports whom, and what an import costs."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import swardmap

SOURCE = Path(swardmap.__file__).parent
ROOT = Path(__file__).parent.parent
BASE = ("errors", "labels", "geometry", "types", "grid", "segmenter", "config")
CORE = (*BASE, "perception", "mapping", "pipeline", "monitor", "rig")
MAY_IMPORT: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(BASE, BASE),
    "kernels": BASE,
    "perception": (*BASE, "kernels"),
    "mapping": (*BASE, "kernels", "perception"),
    "pipeline": (*BASE, "kernels", "perception", "mapping"),
    "monitor": (*BASE, "mapping"),
    "rig": BASE,
    "io": CORE,
    "models": (*CORE, "io"),
    "viz": (*CORE, "io"),
    "runs": (*CORE, "kernels", "io", "models", "viz"),
    "eval": (*CORE, "kernels", "runs", "io", "models", "viz"),
    "synth": (*CORE, "runs", "io"),
    "train": (*CORE, "io", "models", "eval"),  # for the confusion matrix
    "teach": (*CORE, "io", "models", "viz", "eval", "train"),
    "ros": (*CORE, "kernels", "runs", "io", "models"),
}
"""Which rooms a room may import; the command line, the package's door and `python -m` may import all."""
SECTION = r"^(Args|Raises|Attributes):\n((?: {4}.*\n?|\n)+)"
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
    "shapely",
)


def imported_modules(file: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def modules_of(room: str) -> list[str]:
    """Dotted names of a room's modules, or of the module of that name."""
    found = sorted((SOURCE / room).rglob("*.py")) or [SOURCE / f"{room}.py"]
    names = [".".join(("swardmap", *f.relative_to(SOURCE).with_suffix("").parts)) for f in found]
    return [name.removesuffix(".__init__") for name in names]


def arrows(file: Path) -> set[str]:
    """Rooms that a file imports, at its top or later."""
    return {m.split(".")[1] for m in imported_modules(file) if m.startswith("swardmap.")}


def test_importing_swardmap_loads_nothing_heavy() -> None:
    core = ", ".join(name for room in sorted(CORE) for name in modules_of(room))
    code = f"import swardmap, {core}, sys; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_rooms_import_only_what_they_may(room: str) -> None:
    files = sorted((SOURCE / room).rglob("*.py")) or [SOURCE / f"{room}.py"]
    assert files[0].is_file()
    rooms = {p.stem for p in SOURCE.iterdir() if p.is_dir() or p.suffix == ".py"}
    wrong = {
        f"{file.relative_to(SOURCE)} -> {other}"
        for file in files
        for other in (arrows(file) & rooms) - {room, *MAY_IMPORT[room]}
    }
    assert not wrong


def test_every_room_is_named_and_the_top_level_is_small() -> None:
    top = {p.stem for p in SOURCE.glob("*.py")} - {"__init__", "__main__"}
    rooms = {p.parent.name for p in SOURCE.glob("*/__init__.py")}
    assert top | rooms == {*MAY_IMPORT, "cli"}
    assert len(top) <= 8


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
    assert users
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


def test_sections_of_docstrings_are_pairs() -> None:
    """Of a name and words: what the page of the API is made of."""
    for file in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.Module)):
                text = ast.get_docstring(node) or ""
                for name, body in re.findall(
                    r"^(Args|Raises|Attributes):\n((?: {4}.*\n?|\n)+)", text, re.MULTILINE
                ):
                    for line in re.findall(r"^ {4}(\S.*)", body, re.MULTILINE):
                        assert re.match(r"[\w.*, ]+( \([^)]*\))?: ", line), f"{file}: {name}: {line}"


def test_version_is_in_the_changelog() -> None:
    assert f"[{swardmap.__version__}]" in (ROOT / "CHANGELOG.md").read_text()


def test_no_reader_lists_by_hand_what_a_parser_may_raise() -> None:
    """Nobody knows what a parser raises: `io.door.reading` takes whatever it is."""
    listed = [
        f"{file.relative_to(SOURCE)}:{node.lineno}"
        for file in sorted((SOURCE / "io").rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.ExceptHandler)
        and isinstance(node.type, ast.Tuple)
        and len(node.type.elts) > 3
    ]
    assert not listed, f"use `with reading(...)`: {listed}"
