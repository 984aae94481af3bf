"""How kernels are compiled."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba as nb
from numba.core import event

_KERNELS: list[Any] = []


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """`numba.njit` without the interpreter's lock; the machine code is kept on the disk where it can be.

    A kernel is compiled again when its own file has changed; after a change to another that it calls, delete
    `__pycache__`.

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


@contextmanager
def on_first_compile(tell: Callable[[], None]) -> Iterator[None]:
    """Call `tell` once, when a kernel begins to compile inside the block and is not on the disk."""
    listener = _Once(tell)
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)


class _Once(event.Listener):  # type: ignore[misc]  # numba has no types
    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell: Callable[[], None] | None = tell

    def on_start(self, _: Any) -> None:
        tell, self._tell = self._tell, None
        if tell is not None:
            tell()

    def on_end(self, _: Any) -> None:
        """Compiling has ended: nothing to say."""
