"""How kernels are compiled."""

from collections.abc import Callable
from typing import Any

import numba as nb

_KERNELS: list[Any] = []


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """`numba.njit` without the interpreter's lock; the machine code is kept on the disk where it can be.

    A service user without a home and with read-only packages has no such place. Numba refuses that;
    here the kernel is compiled again in every process.

    Args:
        options: more options of `numba.njit`.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        try:
            kernel: Callable[..., Any] = nb.njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # no folder that could be written to
            kernel = nb.njit(nogil=True, **options)(function)
        _KERNELS.append(kernel)
        return kernel

    return decorate


def machine_code_count() -> int:
    """Versions of kernels in this process: more when one was compiled, or read from the disk."""
    return sum(len(kernel.signatures) for kernel in _KERNELS)
