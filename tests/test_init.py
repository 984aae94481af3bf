"""The names at the top of the package are there, and are those that the type checker sees."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import swardmap


@pytest.mark.parametrize("name", swardmap.__all__)
def test_every_name_is_there(name: str) -> None:
    assert getattr(swardmap, name) is not None
    assert name in dir(swardmap)


def test_table_and_type_checker_agree() -> None:
    tree = ast.parse(Path(swardmap.__file__).read_text())
    declared = {
        alias.asname: f"{node.module}"
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("swardmap.")
        for alias in node.names
    }
    assert declared == {name: f"swardmap.{home}" for name, home in swardmap._HOME.items()}


def test_what_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        swardmap.nonsense  # noqa: B018 - the access is the test


def test_nothing_is_reported_to_the_maker_of_onnx_runtime(tmp_path: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "ORT_DISABLE_TELEMETRY"}
    program = "import swardmap, onnxruntime"
    subprocess.run([sys.executable, "-c", program], env=environment | {"HOME": str(tmp_path)}, check=True)
    assert list(tmp_path.rglob("*deviceid*")) == []
