"""Two folders that take each other's name in one step, so that there is never none under either."""

import ctypes
import errno
import os
import platform
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

AT_FDCWD = -100
RENAME_EXCHANGE = 2
SYSCALL_NUMBERS = {"x86_64": 316, "aarch64": 276, "armv7l": 382, "i686": 353}
UNKNOWN = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EPERM)
"""What a kernel, a file system or a sandbox answers that cannot exchange."""


def exchange(first: Path, second: Path) -> bool:
    """Let two paths of one file system take each other's name (renameat2 of Linux, RENAME_EXCHANGE).

    Returns:
        False if this machine or file system cannot; then nothing has happened.

    Raises:
        OSError: for any other reason, such as a missing path.
    """
    rename = _renameat2()
    if rename is None:
        return False
    sys.audit("swardmap.exchange", str(first), str(second))  # calls through ctypes tell nobody
    if rename(os.fsencode(first), os.fsencode(second)) == 0:
        return True
    code = ctypes.get_errno()
    if code in UNKNOWN:
        return False
    raise OSError(code, os.strerror(code), str(first), None, str(second))


@lru_cache(maxsize=1)
def _renameat2() -> Callable[[bytes, bytes], int] | None:
    """The call of the C library, or of the kernel where the library is older than it (glibc 2.28)."""
    if sys.platform != "linux":
        return None
    try:
        library = ctypes.CDLL(None, use_errno=True)
    except OSError:
        return None
    number = SYSCALL_NUMBERS.get(platform.machine())
    if hasattr(library, "renameat2"):
        return lambda a, b: int(library.renameat2(AT_FDCWD, a, AT_FDCWD, b, RENAME_EXCHANGE))
    if number is None or (sys.maxsize < 2**32 and platform.machine() in ("x86_64", "aarch64")):
        return None
    return lambda a, b: int(library.syscall(number, AT_FDCWD, a, AT_FDCWD, b, RENAME_EXCHANGE))
