"""What an image was called before an annotation tool renamed it."""

import re
from urllib.parse import parse_qs, urlsplit

ROBOFLOW = re.compile(r"(.+?)(?:_(png|jpe?g|bmp|tiff?|webp))?\.rf\.[0-9A-Za-z]{8,}(\.\w+)?")
"""NAME_png.rf.HASH.jpg; the hash differs with each version of a data set."""

UPLOADED = re.compile(r"[0-9a-f]{8}-(.+)")
"""Label Studio puts eight digits of a hash before the name of what is uploaded."""


def original_name(name: str) -> str:
    """A name without what Roboflow put behind it.

    >>> original_name("train/000012_png.rf.0a1b2c3d4e5f60718293a4b5c6d7e8f9.jpg"), original_name("a/b.c.png")
    ('train/000012.jpg', 'a/b.c.png')
    """
    found = ROBOFLOW.fullmatch(name)
    return name if found is None else f"{found[1]}{found[3] or ''}"


def uploaded_name(location: str) -> str:
    """The name of a file as it was before Label Studio, from where it keeps it.

    >>> uploaded_name("/data/upload/3/0a1b2c3d-000012.png")
    '000012.png'
    >>> uploaded_name("/data/local-files/?d=lawn/000012.png")
    '000012.png'
    """
    parts = urlsplit(location.replace("\\", "/"))
    path = (parse_qs(parts.query).get("d") or [parts.path])[0]
    name = path.rpartition("/")[2]
    found = UPLOADED.fullmatch(name)
    return name if found is None else found[1]
