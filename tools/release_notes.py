"""What CHANGELOG.md says of a version: the notes of its release.

python tools/release_notes.py 0.1.0
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def release_notes(version: str, changelog: str) -> str:
    """The section of a version, without its title.

    Raises:
        ValueError: if there is none, or nothing in it.
    """
    sections = dict(
        re.findall(r"^## \[([^\]]+)\][^\n]*\n(.*?)(?=^## |\Z)", changelog, re.DOTALL | re.MULTILINE)
    )
    notes = sections.get(version, "").strip()
    if not notes:
        raise ValueError(
            f"expected a section [{version}] with words in CHANGELOG.md, found {', '.join(sections)}"
        )
    return notes


def package_version() -> str:
    """The version in the package's source."""
    found = re.search(
        r'^__version__ = "([^"]+)"', (ROOT / "src/swardmap/__init__.py").read_text(), re.MULTILINE
    )
    return found[1] if found else ""


def main(version: str) -> int:
    """Print the notes of a version, if it is the package's."""
    if version != package_version():
        print(f"expected the tag v{package_version()}, got v{version}", file=sys.stderr)
        return 1
    try:
        print(release_notes(version, (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")))
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
