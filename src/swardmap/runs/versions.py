"""What made a result: versions that belong beside it."""

import platform
from importlib import metadata

from swardmap import __version__


def versions() -> dict[str, str]:
    """Versions of swardmap, Python and the packages that shape a result."""
    names = ("numpy", "numba", "opencv-python-headless", "onnxruntime", "scipy", "rosbags")
    found = {"swardmap": __version__, "python": platform.python_version()}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found
