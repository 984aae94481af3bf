"""Work in processes: who gives up does not wait for what a worker is at."""

import multiprocessing
import time
from pathlib import Path

import pytest

from swardmap.runs.parallel import Tick, each_part


def endless(part: str, _: Tick) -> str:
    """Work without a tick, as compiling a kernel is; says when it begins, and that it could clean up."""
    Path(part).touch()
    try:
        while True:
            time.sleep(0.05)
    finally:
        Path(part).unlink()


def stubborn(part: str, _: Tick) -> str:
    """Work that does not let itself be stopped."""
    Path(part).touch()
    while True:
        try:
            while True:
                time.sleep(0.05)
        except KeyboardInterrupt:
            continue


def begun(folder: Path) -> None:
    until = time.monotonic() + 60
    while not list(folder.iterdir()):
        assert time.monotonic() < until
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("work", "cleaned"), [(endless, True), (stubborn, False)])
def test_an_interrupt_ends_workers_that_have_no_tick(
    tmp_path: Path, work: object, cleaned: bool, capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr("swardmap.runs.parallel.STOP_S", 0.5)
    monkeypatch.setattr("swardmap.runs.parallel.END_S", 2.0)
    interrupted_s = 0.0

    def interrupt(*_: object, **__: object) -> None:
        nonlocal interrupted_s
        begun(tmp_path)
        interrupted_s = time.monotonic()
        raise KeyboardInterrupt

    monkeypatch.setattr("swardmap.runs.parallel.wait", interrupt)
    with pytest.raises(KeyboardInterrupt):
        list(each_part(work, [str(tmp_path / name) for name in "ab"], workers=2))  # type: ignore[arg-type]
    assert time.monotonic() - interrupted_s < 20
    assert not multiprocessing.active_children()
    assert (list(tmp_path.iterdir()) == []) == cleaned
    assert capfd.readouterr() == ("", "")
