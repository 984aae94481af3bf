"""Folders of results: the old one, the new one, or none; never a mixture, never another verb's."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from swardmap.errors import OutputError
from swardmap.io import folders
from swardmap.io.exchange import exchange
from swardmap.io.folders import MARKER, kind_of, new_output_folder
from swardmap.io.staging import staged_folder, sweep


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def made(out: Path, text: str, kind: str = "map", overwrite: bool = False) -> Path:
    with new_output_folder(out, overwrite, kind) as folder:
        (folder / "map.yaml").write_text(text)
    return out


def test_two_folders_exchange_their_names_in_one_step(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    (tmp_path / "a" / "x").touch()
    if not exchange(tmp_path / "a", tmp_path / "b"):
        pytest.skip("this file system cannot exchange names")
    assert (names(tmp_path / "a"), names(tmp_path / "b")) == ([], ["x"])
    with pytest.raises(OSError, match="No such file"):
        exchange(tmp_path / "a", tmp_path / "nothing")


@pytest.mark.parametrize("can_exchange", [True, False])
def test_a_folder_is_replaced_by_one_of_its_kind_only(
    tmp_path: Path, can_exchange: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not can_exchange:
        monkeypatch.setattr(folders, "exchange", lambda *_: False)
    out = made(tmp_path / "out", "old")
    assert kind_of(out) == "map"
    made(out, "new", overwrite=True)
    assert (out / "map.yaml").read_text() == "new"
    for overwrite in (False, True):
        with pytest.raises(OutputError, match="holds a map, not an evaluation"):
            made(out, "other", "evaluation", overwrite)
    assert (out / "map.yaml").read_text() == "new"
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize(
    ("sign", "kind"),
    [("parts/x", "evaluation"), ("eden/x", "gardens"), ("summary.json", "map"), ("camera.yaml", "recording"),
     ("x", "unknown")],
)  # fmt: skip
def test_the_kind_of_a_folder_of_an_earlier_version_is_told_by_its_files(
    tmp_path: Path, sign: str, kind: str
) -> None:
    (tmp_path / sign).parent.mkdir(exist_ok=True)
    (tmp_path / sign).touch()
    assert kind_of(tmp_path) is None
    (tmp_path / MARKER).write_text("Made by swardmap. --overwrite may replace this folder.\n")
    assert kind_of(tmp_path) == kind


HOLD = """
import sys, os, time
from swardmap.io.folders import new_output_folder
from swardmap.io.files import atomic_write
with new_output_folder(sys.argv[1], kind="map") as folder, atomic_write(sys.argv[1] + ".mcap") as file:
    (folder / "half").touch()
    print("ready", flush=True)
    time.sleep(60)
"""


def test_leftovers_of_the_dead_are_removed_and_those_of_the_living_are_not(tmp_path: Path) -> None:
    out = tmp_path / "out"
    run = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(out)],
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": ":".join(sys.path)},
    )
    assert run.stdout is not None
    assert run.stdout.readline() == b"ready\n"
    alive = names(tmp_path)
    assert [name.split(".")[1] for name in alive] == ["out", "out"]
    made(out, "of another run")
    sweep(tmp_path / "out.mcap")
    assert names(tmp_path) == [*alive, "out"]
    run.send_signal(signal.SIGKILL)
    run.wait()
    run.stdout.close()
    assert names(tmp_path) == [*alive, "out"]
    made(out, "again", overwrite=True)
    assert names(tmp_path) == [alive[1], "out"], "the file is another target's"
    sweep(tmp_path / "out.mcap")
    assert names(tmp_path) == ["out"]


def test_a_lock_that_nobody_gives_costs_nothing_but_the_sweeping(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unknown(*_: object) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr("swardmap.io.staging.fcntl.flock", unknown)
    leftover = tmp_path / ".out.0123456789ab.part"
    leftover.mkdir()
    made(tmp_path / "out", "x")
    assert names(tmp_path) == [leftover.name, "out"]


def test_where_names_cannot_be_exchanged_a_kill_between_the_renames_is_put_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = made(tmp_path / "out", "old")
    monkeypatch.setattr(folders, "exchange", lambda *_: False)
    rename = Path.rename

    def killed(self: Path, target: Path) -> Path:
        if target == out:
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", killed)
    with pytest.raises(KeyboardInterrupt):
        made(out, "new", overwrite=True)
    assert not out.exists()
    monkeypatch.undo()
    with pytest.raises(OutputError, match="exists and is not empty"):
        made(out, "newer")
    assert (out / "map.yaml").read_text() == "old"
    assert names(tmp_path) == ["out"]


def test_a_mounted_folder_says_that_it_is_unfinished_until_it_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = made(tmp_path / "out", "old")
    monkeypatch.setattr(folders, "_must_stay", lambda target: target.is_dir())
    replace = Path.replace

    def killed(self: Path, target: Path) -> Path:
        if target == out / "map.yaml":
            raise KeyboardInterrupt
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", killed)
    with pytest.raises(KeyboardInterrupt):
        made(out, "new", overwrite=True)
    assert folders.is_unfinished(out)
    monkeypatch.setattr(Path, "replace", replace)
    with (
        pytest.raises(OutputError, match="x"),
        new_output_folder(out) as folder,
    ):  # no need to say --overwrite
        raise OutputError(f"x {folder}")
    made(out, "new")
    assert names(out) == [MARKER, "map.yaml"]
    assert not folders.is_unfinished(out)
    assert (out / "map.yaml").read_text() == "new"


def test_a_loop_of_links_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(OutputError, match="cannot write"):
        made(tmp_path / "a", "x")


def test_a_staged_folder_is_gone_at_the_end(tmp_path: Path) -> None:
    with staged_folder(tmp_path / "x") as folder:
        (folder / "half").touch()
    assert names(tmp_path) == []
