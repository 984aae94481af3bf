import errno
import os
import resource
from pathlib import Path

import pytest

from swardmap.errors import InputError, OutputError
from swardmap.io import files, folders
from swardmap.io.files import atomic_write, inside, read_bytes, write_together
from swardmap.io.folders import MARKER, new_output_folder


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_a_file_appears_only_when_the_block_ends(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "map.pgm"
    with atomic_write(target) as file:
        file.write(b"half")
        file.flush()
        assert not target.exists()
        file.write(b" and half")
    assert target.read_bytes() == b"half and half"
    assert names(target.parent) == ["map.pgm"]


@pytest.mark.parametrize("error", [RuntimeError("bug"), KeyboardInterrupt()])
def test_an_error_in_the_block_leaves_the_earlier_file(tmp_path: Path, error: BaseException) -> None:
    target = tmp_path / "map.pgm"
    target.write_bytes(b"old")
    with pytest.raises(type(error)), atomic_write(target) as file:  # noqa: PT012
        file.write(b"new")
        raise error
    assert target.read_bytes() == b"old"
    assert names(tmp_path) == ["map.pgm"]


def test_a_file_that_grows_beyond_the_limit_is_one_clear_error(tmp_path: Path) -> None:
    target = tmp_path / "map.pgm"
    target.write_bytes(b"old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))  # the write fails as on a full disk
    try:
        with pytest.raises(OutputError, match=r"cannot write .*map\.pgm: File too large"):
            files.write_bytes(target, bytes(100_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert target.read_bytes() == b"old"
    assert names(tmp_path) == ["map.pgm"]


def test_a_full_disk_is_one_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left on device"):
        files.write_text(tmp_path / "a.txt", "text")
    with pytest.raises(OutputError, match="No space left on device"):
        write_together({tmp_path / "b": b"1", tmp_path / "c": b"2"})
    assert names(tmp_path) == []


def test_a_place_that_cannot_be_written_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OutputError, match="cannot write"):
        files.write_bytes(tmp_path / "file" / "below.txt", b"")
    with pytest.raises(OutputError, match="cannot write"):
        files.write_bytes(tmp_path, b"")
    with pytest.raises(OutputError, match="cannot write"), new_output_folder(tmp_path / "file" / "out"):
        pass
    assert names(tmp_path) == ["file"]


def test_new_files_have_the_usual_permissions(tmp_path: Path) -> None:
    old = os.umask(0o022)
    try:
        files.write_bytes(tmp_path / "a", b"")
    finally:
        os.umask(old)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o644


def test_files_written_together_are_all_new_or_all_old(tmp_path: Path) -> None:
    image, head = tmp_path / "m.pgm", tmp_path / "m.yaml"
    write_together({image: b"image 1", head: b"head 1"})
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="there is a folder of that name"):
        write_together({image: b"image 2", tmp_path / "folder": b"", head: b"head 2"})
    assert (image.read_bytes(), head.read_bytes()) == (b"image 1", b"head 1")
    write_together({image: b"image 2", head: b"head 2"})
    assert (image.read_bytes(), head.read_bytes()) == (b"image 2", b"head 2")
    assert names(tmp_path) == ["folder", "m.pgm", "m.yaml"]


def test_an_old_head_never_stands_beside_a_new_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    image, head = tmp_path / "m.pgm", tmp_path / "m.yaml"
    write_together({image: b"image 1", head: b"head 1"})
    replace = Path.replace

    def fails_on_head(self: Path, target: Path) -> Path:
        if target == head:
            raise OSError(errno.EIO, "input/output error")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", fails_on_head)
    with pytest.raises(OutputError, match=r"m\.yaml"):
        write_together({image: b"image 2", head: b"head 2"})
    assert not head.exists()


def test_a_folder_appears_complete(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with new_output_folder(out) as folder:
        (folder / "map.yaml").write_text("x")
        assert not out.exists()
    assert names(out) == [MARKER, "map.yaml"]
    assert names(tmp_path) == ["out"]


def test_an_empty_folder_is_taken(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    with new_output_folder(out):
        pass
    assert names(out) == [MARKER]


def test_a_folder_in_use_is_refused(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with new_output_folder(out) as folder:
        (folder / "a").write_text("old")
    with pytest.raises(OutputError, match="--overwrite"), new_output_folder(out):
        pytest.fail("must not get here")
    assert (out / "a").read_text() == "old"


def test_overwrite_replaces_only_what_swardmap_made(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputError, match="not made by swardmap"), new_output_folder(out, overwrite=True):
        pytest.fail("must not get here")
    assert names(out) == ["thesis.tex"]
    with pytest.raises(OutputError, match="is a file"), new_output_folder(out / "thesis.tex", True):
        pytest.fail("must not get here")


@pytest.mark.parametrize("mounted", [False, True])
def test_the_old_output_stays_whole_until_the_new_one_is_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mounted: bool
) -> None:
    out = tmp_path / "out"
    with new_output_folder(out) as folder:
        (folder / "a").write_text("old")
    monkeypatch.setattr(folders, "_must_stay", lambda _: mounted)
    inode = out.stat().st_ino
    with pytest.raises(KeyboardInterrupt), new_output_folder(out, overwrite=True) as folder:  # noqa: PT012
        (folder / "b").write_text("new")
        raise KeyboardInterrupt
    assert names(out) == [MARKER, "a"]
    with new_output_folder(out, overwrite=True) as folder:
        (folder / "b").write_text("new")
        assert (out / "a").read_text() == "old"
    assert names(out) == [MARKER, "b"]
    assert names(tmp_path) == ["out"]
    assert (out.stat().st_ino == inode) == mounted


def test_a_failed_rename_brings_the_old_folder_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    with new_output_folder(out) as folder:
        (folder / "a").write_text("old")
    rename = Path.rename

    def fails_for_new(self: Path, target: Path) -> Path:
        if (self / "b").exists():
            raise OSError(errno.EIO, "input/output error")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", fails_for_new)
    monkeypatch.setattr(folders, "exchange", lambda *_: False)
    with (
        pytest.raises(OutputError, match="input/output error"),
        new_output_folder(out, overwrite=True) as folder,
    ):
        (folder / "b").write_text("new")
    assert names(out) == [MARKER, "a"]
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("name", ["../a", "a/../../b", "/etc/passwd", "", "..", "C:\\x", "..\\a", "a\0b"])
def test_names_that_lead_out_are_refused(name: str) -> None:
    with pytest.raises(InputError, match="inside"):
        inside(Path("out"), name)


def test_names_inside_pass() -> None:
    assert inside(Path("out"), "a/b.png") == Path("out/a/b.png")


def test_read_bytes_says_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_bytes(tmp_path / "none")
    (tmp_path / "big").write_bytes(bytes(11))
    with pytest.raises(InputError, match="at most 10 bytes"):
        read_bytes(tmp_path / "big", limit=10)
    with pytest.raises(InputError, match="cannot read"):
        read_bytes("a\0b")


def test_of_two_runs_into_one_folder_the_first_to_end_stays(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with (
        pytest.raises(OutputError, match=r"cannot write .*out: Directory not empty"),
        new_output_folder(target),
        new_output_folder(target) as first,
    ):
        (first / "map.pgm").write_bytes(b"first")
    assert names(tmp_path) == ["out"]
    assert (target / "map.pgm").read_bytes() == b"first"


def test_a_pointer_of_git_lfs_is_named(tmp_path: Path) -> None:
    file = tmp_path / "a.png"
    file.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12345\n")
    with pytest.raises(InputError, match="git lfs pull"):
        read_bytes(file)
