"""The verbs, and the edge at which known errors become one line."""

import os
import sys
from contextlib import suppress

import typer
from typer.main import get_command

from swardmap import __version__
from swardmap.cli.compare import EXAMPLES as COMPARE_EXAMPLES
from swardmap.cli.compare import compare_command
from swardmap.cli.config import config
from swardmap.cli.convert import convert
from swardmap.cli.demo import demo
from swardmap.cli.doctor import doctor
from swardmap.cli.evaluate import EXAMPLES as EVALUATE_EXAMPLES
from swardmap.cli.evaluate import evaluate_command
from swardmap.cli.export import export
from swardmap.cli.help import complete
from swardmap.cli.map import EXAMPLES as MAP_EXAMPLES
from swardmap.cli.map import map_command
from swardmap.cli.nav2 import EXAMPLES as NAV2_EXAMPLES
from swardmap.cli.nav2 import nav2_command
from swardmap.cli.record import EXAMPLES as RECORD_EXAMPLES
from swardmap.cli.record import record_command
from swardmap.cli.ros import EXAMPLES as ROS_EXAMPLES
from swardmap.cli.ros import ros_command
from swardmap.cli.synth import EXAMPLES as SYNTH_EXAMPLES
from swardmap.cli.synth import synth
from swardmap.cli.teach import EXAMPLES as TEACH_EXAMPLES
from swardmap.cli.teach import teach_command
from swardmap.cli.train import EXAMPLES as TRAIN_EXAMPLES
from swardmap.cli.train import train
from swardmap.cli.view import EXAMPLES as VIEW_EXAMPLES
from swardmap.cli.view import view_command
from swardmap.errors import SwardmapError, one_line

app = typer.Typer(
    name="swardmap",
    help="From RGB-D to an obstacle map a mowing robot can trust.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"swardmap {__version__}")
        raise typer.Exit


@app.callback()
def _top(
    version: bool = typer.Option(
        False, "--version", callback=_show_version, is_eager=True, help="Print the version."
    ),
) -> None:
    """From RGB-D to an obstacle map a mowing robot can trust."""


app.command("map", epilog=MAP_EXAMPLES)(map_command)
app.command("record", epilog=RECORD_EXAMPLES)(record_command)
app.command("view", epilog=VIEW_EXAMPLES)(view_command)
app.command("demo")(demo)
app.command("evaluate", epilog=EVALUATE_EXAMPLES)(evaluate_command)
app.command("compare", epilog=COMPARE_EXAMPLES)(compare_command)
app.command("convert")(convert)
app.command("synth", epilog=SYNTH_EXAMPLES)(synth)
app.command("teach", epilog=TEACH_EXAMPLES)(teach_command)
app.command("train", epilog=TRAIN_EXAMPLES)(train)
app.command("export")(export)
app.command("ros", epilog=ROS_EXAMPLES)(ros_command)
app.command("nav2", epilog=NAV2_EXAMPLES)(nav2_command)
app.command("config")(config)
app.command("doctor")(doctor)


def run(arguments: list[str]) -> int:
    """Run one command line.

    Returns:
        0 if all went well, 1 for a known error, 2 for wrong usage, 130 after Ctrl-C.
    """
    try:
        code = _run(arguments)
        if sys.stdout is not None:  # closed by who started us
            sys.stdout.flush()
    except (BrokenPipeError, SystemExit):  # who reads has seen enough; typer exits where it notices
        _drop_output()
        return 0
    except OSError as error:
        if error.filename is not None:
            raise
        _drop_output()
        _say(f"swardmap: cannot write to the standard output: {error.strerror or one_line(error)}")
        return 1
    return code


def _run(arguments: list[str]) -> int:
    try:
        result = complete(get_command(app)).main(arguments, prog_name="swardmap", standalone_mode=False)
    except SwardmapError as error:
        _say(f"swardmap: {one_line(error)}")
        return 1
    except MemoryError:
        _say("swardmap: there is not enough memory: try fewer frames, larger cells or fewer processes")
        return 1
    except (KeyboardInterrupt, typer.Abort) as stop:
        return _interrupted(*stop.args)
    except OSError:
        raise
    except Exception as error:
        show = getattr(error, "show", None)  # click's usage errors
        if show is None:
            raise
        show()
        return int(getattr(error, "exit_code", 2))
    if result == 130:  # typer's own catch of Ctrl-C
        return _interrupted()
    return result if isinstance(result, int) else 0


def _interrupted(*about: object) -> int:
    _say(one_line(": ".join(["swardmap: interrupted", *map(str, about)])))
    return 130


def _say(line: str) -> None:
    with suppress(OSError):
        print(line, file=sys.stderr)


def _drop_output() -> None:
    """Let the rest go nowhere: the interpreter would try to write it again, and complain, at its end."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
