import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core import caching

from swardmap import kernels
from swardmap.kernels.compiled import compiled, machine_code_count, on_first_compile


def doubled(values: "np.ndarray[tuple[int], np.dtype[np.int64]]") -> int:
    return int(2 * values.sum())


def test_where_nothing_can_be_written_kernels_still_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(caching.CompileResultCacheImpl, "_locator_classes", [])
    with pytest.raises(RuntimeError, match="no locator"):
        caching.FunctionCache(doubled)  # the trap is set
    assert compiled()(doubled)(np.arange(4)) == 12


def test_the_machine_code_is_kept_where_it_can_be() -> None:
    kernel = compiled()(doubled)
    assert getattr(kernel, "_cache").cache_path  # noqa: B009 - numba has no public name for it


def test_every_kernel_is_imported_where_nothing_can_be_written() -> None:
    """The use and not only the decorator: a bare `njit(cache=True)` stops a service without a home."""
    names = [f"swardmap.kernels.{p.stem}" for p in Path(kernels.__file__).parent.glob("[a-z]*.py")]
    assert len(names) > 5
    code = (
        "from numba.core import caching; caching.CompileResultCacheImpl._locator_classes = []; "
        f"import importlib; [importlib.import_module(name) for name in {names!r}]"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-500:]


def test_new_machine_code_is_counted_once_for_each_layout() -> None:
    kernel = compiled()(doubled)
    before = machine_code_count()
    for values in (np.arange(4), np.arange(5), np.arange(8)[::2]):
        kernel(values)
    assert machine_code_count() == before + 2


def test_compiling_is_told_once_and_what_is_there_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(caching.CompileResultCacheImpl, "_locator_classes", [])  # nothing is on the disk
    told: list[str] = []
    kernel = compiled()(doubled)
    with on_first_compile(lambda: told.append("compiling")):
        kernel(np.arange(3, dtype=np.int16))
        kernel(np.arange(3, dtype=np.int8))
    assert told == ["compiling"]
    with on_first_compile(lambda: told.append("again")):
        kernel(np.arange(3, dtype=np.int16))
    kernel(np.arange(3, dtype=np.uint8))
    assert told == ["compiling"]
