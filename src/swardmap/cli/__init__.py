"""The command line: the only place that prints, exits, or catches everything."""

import sys


def main() -> None:
    """Run the command line; exit with 0, with 1 for a known error in one line, with 2 for wrong usage."""
    from swardmap.cli.app import run

    sys.exit(run(sys.argv[1:]))
