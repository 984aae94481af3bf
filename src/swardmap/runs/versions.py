"""What made a result: versions that belong beside it."""

import platform
from hashlib import sha256
from importlib import metadata

from swardmap import __version__
from swardmap.config import Config


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


def network_digest(config: Config) -> str:
    """Tells network files apart, so that results of two networks of one name are never mixed; empty without.

    Raises:
        InputError: if the file of the network cannot be read.
    """
    from swardmap.io.files import read_bytes
    from swardmap.models import network_file

    path = network_file(config.segmenter.name)
    return "" if path is None else sha256(read_bytes(path)).hexdigest()[:16]


def segmenter_title(config: Config, digest: str | None = None) -> str:
    """What a report calls the segmenter; a network file with the head of its digest.

    Args:
        config: names the segmenter.
        digest: of `network_digest`; None = it is looked up.

    Raises:
        InputError: if the file of the network cannot be read.
    """
    digest = network_digest(config) if digest is None else digest
    return f"{config.segmenter.name} (network {digest[:8]})" if digest else config.segmenter.name
