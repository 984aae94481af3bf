import numpy as np
import pytest
from numba.core import caching

from swardmap.kernels.compiled import compiled


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
