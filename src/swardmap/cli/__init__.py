"""The command line: the only place that prints, exits, or catches everything."""

import signal
import sys


def main() -> None:
    """Run the command line; exit with 0, with 1 for a known error in one line, with 2 for wrong usage.

    A stop by the system (SIGTERM, a closed terminal) is taken as Ctrl-C: what was finished stays whole,
    and nothing half-written is left beside it.
    """
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:  # not under nohup
            signal.signal(number, _interrupt)
    try:
        from swardmap.cli.app import run
    except KeyboardInterrupt:
        sys.exit(130)
    sys.exit(run(sys.argv[1:]))


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt
