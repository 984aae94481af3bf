"""Recordings as files: packed, split, without metadata, killed while they were written, with odd times."""

import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.io import open_source as open_any
from swardmap.io.bags.rosbag import REASON_STAMP, open_source, recognises
from swardmap.io.sources.pairing import REASON_ORDER
from tests import bags
from tests.bags import Event
from tests.lawn_bags import COLOR, DEPTH, MS, START_NS, Lawn, mapped

STORES = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}
SUFFIX = {"sqlite3": ".db3", "mcap": ".mcap"}


def packed_bag(folder: Path, kind: str, mode: CompressionMode) -> Path:
    """As `ros2 bag record --compression-format zstd --compression-mode file|message` writes it."""
    path, store = folder / f"{kind}_{mode.name}".lower(), bags.typestore("mcap")
    writer = Writer(path, version=8, storage_plugin=STORES[kind])
    writer.set_compression(mode, CompressionFormat.ZSTD)
    connections: dict[str, Any] = {}
    with writer:
        for t, topic, name, fields in Lawn().events():
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            assert isinstance(fields, dict)
            writer.write(connections[topic], t, bags.serialized(store, "mcap", name, fields))
    return path


def check_box(path: Path) -> Any:
    found = mapped(path)
    assert (found.frames, found.on_box, found.elsewhere) == (6, 72, 0), found.source.facts
    return found


def storage_file(bag: Path) -> Path:
    return next(p for p in bag.iterdir() if p.name != "metadata.yaml")


@pytest.mark.parametrize("kind", STORES)
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_packed_recordings(tmp_path: Path, kind: str, mode: CompressionMode) -> None:
    bag = packed_bag(tmp_path, kind, mode)
    assert recognises(bag)
    check_box(bag)
    bare = tmp_path / storage_file(bag).name  # and without the metadata that says so
    shutil.copy(storage_file(bag), bare)
    assert recognises(bare)
    assert bare.name.endswith(".zstd") is (mode == CompressionMode.FILE)
    check_box(bare)
    assert not list(tmp_path.parent.glob("swardmap-*"))


def test_packed_files_that_are_damaged(tmp_path: Path) -> None:
    bag = packed_bag(tmp_path, "mcap", CompressionMode.FILE)
    file = storage_file(bag)
    file.write_bytes(file.read_bytes()[:-200])
    with pytest.raises(InputError, match="cannot be read"):
        open_source(bag, SourceConfig())


@pytest.mark.parametrize("kind", STORES)
def test_a_folder_without_metadata(tmp_path: Path, kind: bags.Kind) -> None:
    bag = bags.write_bag(tmp_path, kind, Lawn().events())
    (bag / "metadata.yaml").unlink()
    assert recognises(bag)
    check_box(bag)


@pytest.mark.parametrize("kind", STORES)
@pytest.mark.parametrize("with_metadata", [True, False])
def test_a_split_recording(tmp_path: Path, kind: bags.Kind, with_metadata: bool) -> None:
    events, whole = Lawn().events(), tmp_path / "drive"
    whole.mkdir()
    middle = START_NS + 250 * MS
    for number, part in enumerate(
        ([e for e in events if e[0] < middle], [e for e in events if e[0] >= middle])
    ):
        (tmp_path / str(number)).mkdir()
        one = bags.write_bag(tmp_path / str(number), kind, part)
        shutil.copy(storage_file(one), whole / f"drive_{number}{SUFFIX[kind]}")
        metadata = yaml.safe_load((one / "metadata.yaml").read_text())
    if with_metadata:
        files = [f"drive_{number}{SUFFIX[kind]}" for number in range(2)]
        metadata["rosbag2_bagfile_information"] |= {
            "relative_file_paths": files,
            "message_count": len(events),
        }
        (whole / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    found = check_box(whole)
    assert found.source.notes == []


def test_several_recordings_in_one_folder_are_not_one(tmp_path: Path) -> None:
    for name in ("monday", "tuesday"):
        (tmp_path / name).mkdir()
        shutil.copy(
            storage_file(bags.write_bag(tmp_path / name, "mcap", Lawn().events())), tmp_path / f"{name}.mcap"
        )
        shutil.rmtree(tmp_path / name)
    with pytest.raises(InputError, match=r"one of them by itself\. Found monday\.mcap, tuesday\.mcap"):
        open_source(tmp_path, SourceConfig())


def test_metadata_without_the_kind_of_storage(tmp_path: Path) -> None:
    bag = bags.write_bag(tmp_path, "mcap", Lawn().events())
    text = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(text.replace("storage_identifier: mcap", 'storage_identifier: ""'))
    check_box(bag)


def test_metadata_that_counts_more_than_there_is(tmp_path: Path) -> None:
    bag = bags.write_bag(tmp_path, "mcap", Lawn().events())
    count = len(Lawn().events())
    text = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(
        text.replace(f"message_count: {count}\n", f"message_count: {count + 7}\n")
    )
    found = check_box(bag)
    assert found.source.notes == [
        f"metadata.yaml names {count + 7} messages, the files hold {count}: some are lost"
    ]


@pytest.mark.parametrize(
    "text", ["", "rosbag2_bagfile_information: 3", "{", "rosbag2_bagfile_information: {}"]
)
def test_metadata_that_are_none(tmp_path: Path, text: str) -> None:
    bag = bags.write_bag(tmp_path, "mcap", Lawn().events())
    (bag / "metadata.yaml").write_text(text)
    with pytest.raises(InputError, match=r"metadata\.yaml"):
        open_source(bag, SourceConfig())


@pytest.fixture
def killed(tmp_path: Path) -> Iterator[Path]:
    """A recorder was killed: half of the messages lie in SQLite's log."""
    whole = storage_file(bags.write_bag(tmp_path, "sqlite3", Lawn().events()))
    out = tmp_path / "killed"
    out.mkdir()
    first, second = sqlite3.connect(whole), sqlite3.connect(tmp_path / "open.db3")
    second.execute("PRAGMA journal_mode=WAL")
    second.execute("PRAGMA wal_autocheckpoint=0")
    tables = first.execute(
        "select name, sql from sqlite_master where type = 'table' and name not like 'sqlite_%'"
    )
    rows: list[Any] = []
    for name, sql in tables.fetchall():
        second.execute(sql)
        found = first.execute(f"select * from {name}").fetchall()  # noqa: S608 - names of our own file
        rows = found if name == "messages" else rows
        for row in found if name != "messages" else []:
            second.execute(f"insert into {name} values ({','.join('?' * len(row))})", row)  # noqa: S608
    for part in (rows[: len(rows) // 2], rows[len(rows) // 2 :]):
        second.executemany(f"insert into messages values ({','.join('?' * len(rows[0]))})", part)  # noqa: S608
        second.commit()
        if part[0] is rows[0]:
            second.execute("PRAGMA wal_checkpoint(FULL)")
    for end in ("", "-wal", "-shm"):
        shutil.copy(tmp_path / f"open.db3{end}", out / f"killed_0.db3{end}")
    yield out
    first.close()
    second.close()


def test_messages_in_the_log_of_a_killed_recorder(killed: Path) -> None:
    with pytest.raises(InputError, match=r"killed_0\.db3-wal .*PRAGMA wal_checkpoint\(TRUNCATE\)") as caught:
        open_any(killed)
    command = str(caught.value).rpartition('python3 -c "')[2].rstrip('"')
    exec(command)  # noqa: S102 - what the user is told to do
    check_box(killed)


# ---- times


def restamped(events: list[Event], change: dict[tuple[str, int], int]) -> list[Event]:
    """Header stamps of single images (by topic and number) set to a time in ns."""
    seen: dict[str, int] = {}
    out = []
    for t, topic, kind, fields in events:
        number = seen.get(topic, 0)
        seen[topic] = number + 1
        if (topic, number) in change and isinstance(fields, dict):
            stamp = change[topic, number]
            header = {**fields["header"], "stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}
            fields = {**fields, "header": header}
        out.append((t, topic, kind, fields))
    return out


FUTURE_NS, TOMORROW_NS = 2_000_000_000 * 10**9, START_NS + 86_400 * 10**9


@pytest.mark.parametrize("stamp_ns", [0, FUTURE_NS, TOMORROW_NS, START_NS + 5 * 10**9])
@pytest.mark.parametrize("number", [0, 1, 5, 11])
@pytest.mark.parametrize("topic", [COLOR, DEPTH])
def test_one_image_of_another_time_costs_one_image(
    tmp_path: Path, topic: str, number: int, stamp_ns: int
) -> None:
    events = restamped(Lawn(frames=12).events(), {(topic, number): stamp_ns})
    source = open_source(bags.write_bag(tmp_path, "mcap", events), SourceConfig())
    assert len(list(source)) == 11
    assert sum(source.skipped.values()) == 2  # the image and its partner
    if 0 < number < 11:
        assert source.skipped[REASON_STAMP] == 1
        assert (
            f"an image of {topic} of {stamp_ns / 1e9:.3f} s"
            in source.facts["left_out"][REASON_STAMP]["first"]
        )


def test_streams_without_any_time(tmp_path: Path) -> None:
    change = {(topic, number): 0 for topic in (COLOR, DEPTH) for number in range(6)}
    source = open_source(bags.write_bag(tmp_path, "mcap", restamped(Lawn().events(), change)), SourceConfig())
    frames = list(source)
    assert [f.stamp_ns for f in frames] == [START_NS + (100 * i + 6) * MS for i in range(6)]
    assert source.notes == [
        f"images of {t} have no times: those of their recording are taken" for t in (COLOR, DEPTH)
    ]


def test_simulated_time_that_begins_at_zero(tmp_path: Path) -> None:
    def simulated(event: Event) -> Event:
        t, topic, kind, fields = event
        assert isinstance(fields, dict)
        parts = fields.get("transforms", [fields])
        for part in parts:
            stamp = part["header"]["stamp"]
            ns = max(0, stamp["sec"] * 10**9 + stamp["nanosec"] - START_NS)
            part["header"] = {**part["header"], "stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}}
        return t, topic, kind, fields

    events = [simulated(e) for e in Lawn().events() if e[0] >= START_NS or e[1] == "/tf_static"]
    check_box(bags.write_bag(tmp_path, "mcap", events))


def test_a_clock_that_was_set_goes_on(tmp_path: Path) -> None:
    change = {(t, n): TOMORROW_NS + n * 100 * MS for t in (COLOR, DEPTH) for n in range(20, 40)}
    events = restamped(Lawn(frames=40, with_tf=False).events(), change)
    source = open_source(bags.write_bag(tmp_path, "mcap", events), SourceConfig())
    assert len(list(source)) == 40
    assert source.skipped == {}


def test_a_recording_that_was_looped(tmp_path: Path) -> None:
    once = Lawn(with_tf=False).events()
    again = [(t + 10**9, topic, kind, fields) for t, topic, kind, fields in once]
    source = open_source(bags.write_bag(tmp_path, "mcap", [*once, *again]), SourceConfig())
    assert len(list(source)) == 6
    assert source.skipped == {REASON_ORDER: 12}
    assert "came after one of" in source.facts["left_out"][REASON_ORDER]["first"]


@pytest.mark.parametrize("shift_ms", [7, 15])
def test_how_far_pairs_are_apart_is_told(tmp_path: Path, shift_ms: int) -> None:
    source = open_source(
        bags.write_bag(tmp_path, "mcap", Lawn(depth_shift_ms=shift_ms).events()), SourceConfig()
    )
    list(source)
    assert source.facts["pairing"] == {"pairs": 6, "median_ms": float(shift_ms), "worst_ms": float(shift_ms)}


def test_images_too_far_apart_are_told_by_how_much(tmp_path: Path) -> None:
    source = open_source(bags.write_bag(tmp_path, "mcap", Lawn(depth_shift_ms=33).events()), SourceConfig())
    assert list(source) == []
    first = [said["first"] for said in source.facts["left_out"].values()]
    assert all("the nearest is 33.0 ms away (source.pair_tolerance_ms)" in said for said in first)
