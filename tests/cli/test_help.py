"""Help on a terminal of 80 columns: nothing is cut, and every default is told."""

import re
import shutil
from pathlib import Path

import pytest

from swardmap.cli import help as help_module
from swardmap.cli.app import app, run
from swardmap.config import Config

VERBS = sorted(command.name or "" for command in app.registered_commands)


def shown(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert run([*arguments, "--help"]) == 0
    return capsys.readouterr().out


@pytest.fixture(autouse=True)
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert shutil.get_terminal_size().columns == 80


def test_the_list_of_verbs_is_whole(capsys: pytest.CaptureFixture[str]) -> None:
    text = shown(capsys)
    assert "..." not in text.split("Commands:")[1]
    for verb in VERBS:
        assert f"{verb:<10}{help_module.SHORT[verb]}" in text


@pytest.mark.parametrize("verb", VERBS)
def test_no_line_is_too_long_and_every_option_tells_its_default(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = shown(capsys, verb)
    words = text.split("\n  Examples:\n")[0]  # commands are copied whole
    assert max(map(len, words.splitlines())) <= 80
    options = text.split("\nOptions:\n")[1].split("\n\n")[0]
    for entry in re.split(r"\n(?=  -)", options):
        takes_a_value = "<" in entry.split("  ")[1] or "KEY=VALUE" in entry
        if takes_a_value:
            assert re.search(r"\[(default:|.*required)", entry), entry


def test_defaults_are_those_of_the_settings(capsys: pytest.CaptureFixture[str]) -> None:
    flat = " ".join(shown(capsys, "map").split())
    assert f"Edge of a map cell in metres. [default: ({Config().grid.resolution_m})]" in flat
    assert f"[default: ({Config().segmenter.name})]" in flat


def test_the_words_for_defaults_are_of_options_that_exist(tmp_path: Path) -> None:
    from typer.main import get_command

    group = help_module.complete(get_command(app))
    names = {p.name for command in group.commands.values() for p in command.params}
    assert names >= {*help_module.DEFAULT, *help_module.SETTING_OF}
    assert set(help_module.SHORT) == set(VERBS)
