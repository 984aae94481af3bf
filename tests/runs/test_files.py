import pytest

from swardmap.runs.files import _every_nth


@pytest.mark.parametrize("frames", [1, 24, 50, 75, 120, 300, 9_999, 100_000])
def test_a_long_recording_gives_about_fifty_pictures(frames: int) -> None:
    every = _every_nth(None, frames)
    assert min(frames, 34) <= len(range(0, frames, every)) <= 75


def test_what_is_configured_holds() -> None:
    assert [_every_nth(n, 10_000) for n in (0, 1, 7)] == [0, 1, 7]
    assert _every_nth(None, None) > 1
