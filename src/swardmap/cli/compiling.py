"""Says so while kernels compile: the first run on a machine otherwise stands still for seconds."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def told_when_compiling() -> Iterator[None]:
    """Print one line to stderr when the first kernel compiles inside the block."""
    from swardmap.kernels.compiled import on_first_compile

    with on_first_compile(lambda: print("compiling kernels, once on this machine ...", file=sys.stderr)):
        yield
