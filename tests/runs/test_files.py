import sys

import pytest

from swardmap.runs.files import _every_nth, typed_command


@pytest.mark.parametrize("frames", [1, 24, 50, 75, 120, 300, 9_999, 100_000])
def test_a_long_recording_gives_about_fifty_pictures(frames: int) -> None:
    every = _every_nth(None, frames)
    assert min(frames, 34) <= len(range(0, frames, every)) <= 75


def test_what_is_configured_holds() -> None:
    assert [_every_nth(n, 10_000) for n in (0, 1, 7)] == [0, 1, 7]
    assert _every_nth(None, None) > 1


@pytest.mark.parametrize(
    ("argv", "told"),
    [
        (["/usr/bin/swardmap", "map", "a b"], "swardmap map 'a b'"),
        (["/lib/swardmap/__main__.py", "demo"], "swardmap demo"),
        (["/lib/pytest/__main__.py", "tests"], None),
        (["-c"], None),
        ([], None),
    ],
)
def test_only_a_command_of_ours_is_told(
    argv: list[str], told: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", argv)
    assert typed_command() == told
