"""Frames that the node would refuse do not clear cells of a recording's map either."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swardmap.cli.app import run
from swardmap.config import WatchdogConfig, config_from_dict
from swardmap.errors import InputError
from swardmap.geometry import Intrinsics
from swardmap.io.sources.folder import write_folder
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.monitor.diagnostics import frame_stats
from swardmap.monitor.watchdog import Watchdog
from swardmap.runs.frame_check import FrameCheck
from swardmap.runs.record_looks import Looker, watchdog_of, with_mask
from swardmap.runs.recording import MapRun, map_recording
from swardmap.runs.told import report_lines
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.types import Frame, Segmentation

SMALL = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
TRUTH = config_from_dict({"segmenter": {"name": "truth"}, "output": {"pictures": 0}})
Change = Callable[[Frame], Frame]


class Given(AnalyticSource):
    """A drive whose frames were changed."""

    def __init__(self, change: Callable[[Sequence[Frame]], Sequence[Frame]], count: int = 6) -> None:
        drive = AnalyticSource(garden_scene(0), tuple(lane_poses(count, step_m=0.4)), SMALL)
        self.__dict__.update(drive.__dict__)
        self.frames = change(list(drive))

    def __iter__(self) -> Any:
        yield from self.frames


def turned(frame: Frame) -> Frame:
    rgb, depth, labels = (np.ascontiguousarray(a[::-1, ::-1]) for a in (frame.rgb, frame.depth, frame.labels))  # type: ignore[index]
    return replace(frame, rgb=rgb, depth=depth, labels=labels)


def black(frame: Frame) -> Frame:
    return replace(frame, rgb=np.zeros_like(frame.rgb))


def blind(frame: Frame) -> Frame:
    return replace(frame, depth=np.zeros_like(frame.depth))


def frozen(frames: Sequence[Frame]) -> list[Frame]:
    first = frames[0]
    return [replace(f, rgb=first.rgb, depth=first.depth, labels=first.labels) for f in frames]


def at(indices: Sequence[int], change: Change) -> Callable[[Sequence[Frame]], list[Frame]]:
    return lambda frames: [change(f) if i in indices else f for i, f in enumerate(frames)]


def cells(found: MapRun, free: bool) -> set[tuple[int, int]]:
    """Cells of a map, counted from its lattice: the free ones, or all that are known."""
    grid = found.grid
    assert grid is not None
    iy, ix = np.nonzero(grid.classes == MapClass.GRASS if free else grid.classes)
    ox, oy = (round(v / grid.spec.resolution_m) for v in grid.spec.origin_m)
    return {(int(x) + ox, int(y) + oy) for x, y in zip(ix, iy, strict=True)}


CASES: list[tuple[str, Callable[[Sequence[Frame]], Sequence[Frame]], str, int]] = [
    ("frozen", frozen, "frozen", 5),
    ("upside down", at([2, 3], turned), "flipped", 2),
    ("black", at([1], black), "black", 1),
    ("without depth", at([4], blind), "no depth", 1),
]


@pytest.mark.parametrize(("change", "fault", "count"), [c[1:] for c in CASES], ids=[c[0] for c in CASES])
def test_a_frame_that_the_node_refuses_is_named_and_frees_nothing(
    change: Callable[[Sequence[Frame]], Sequence[Frame]], fault: str, count: int
) -> None:
    source = Given(change)
    found = map_recording(source, config=TRUTH)
    assert found.summary["watchdog"]["faults"] == {fault: count}
    assert found.summary["watchdog"]["refused"] == count
    assert found.summary["frames"] == 6 - count
    good = map_recording(Given(list), config=TRUTH)
    assert cells(found, free=True) <= cells(good, free=False), "no cell is free that was never seen"
    node = Watchdog(["camera"], TRUTH.watchdog)
    mount = source.frames[0].T_map_camera
    fit = [node.observe_frame("camera", frame_stats(f, f.stamp_ns, mount)) for f in source.frames]
    check = FrameCheck(TRUTH.watchdog)
    assert [check.is_fit(f) for f in source.frames] == fit, "as the node says"
    looker = Looker(TRUTH.watchdog)
    records = [{"looks": looker.see(i, frame)} for i, frame in enumerate(source.frames)]
    assert watchdog_of(records, TRUTH.watchdog)["faults"] == {fault: count}


def test_strict_stops_at_the_first_and_all_faulty_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"frame .*: flipped \(--strict stops here\)"):
        map_recording(Given(at([2], turned)), tmp_path / "out", TRUTH, strict=True)
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match=r"all are faulty \(6 x flipped\)"):
        map_recording(Given(at(range(6), turned)), tmp_path / "out", TRUTH)


class Doubter:
    """The true labels, said to be unfamiliar in the frames of these names."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names, self.name, self.label_set = names, "doubter", GRASS_OBSTACLE_PERSON

    def __call__(self, frame: Frame) -> Segmentation:
        assert frame.labels is not None
        assert frame.label_set is not None
        strange = frame.name in self.names
        return Segmentation(frame.labels, frame.label_set, unfamiliar=1.5 if strange else 0.5)


def test_frames_that_the_network_does_not_know_are_counted_and_free_nothing(tmp_path: Path) -> None:
    source = Given(list)
    names = [f.name for f in source.frames]
    assert len(set(names)) == 6
    good = map_recording(Given(list), config=TRUTH)
    found = map_recording(source, config=TRUTH, segmenter=Doubter(names[3:]))
    assert found.summary["watchdog"] == {
        "refused": 0, "faults": {"unfamiliar": 3}, "first": {"unfamiliar": names[3]}, "doubts": {},
    }  # fmt: skip
    assert found.summary["frames"] == 6
    lines = report_lines(found.summary)
    assert f"unfamiliar to the network: 3 frames cleared nothing (first: {names[3]})" in lines
    assert not found.summary["warnings"]
    half = map_recording(Given(lambda frames: frames[:3]), config=TRUTH)
    assert (
        cells(found, free=True) <= cells(half, free=True) < cells(good, free=True)
    )  # what it sees is doubted
    all_strange = map_recording(Given(list), config=TRUTH, segmenter=Doubter(names))
    assert cells(all_strange, free=True) == set()
    assert "6 of 6 frames are unfamiliar to the network" in all_strange.summary["warnings"][0]
    off = replace(TRUTH, watchdog=WatchdogConfig(unfamiliar=None))
    unasked = map_recording(Given(list), config=off, segmenter=Doubter(names))
    assert unasked.summary["watchdog"]["faults"] == {}
    assert cells(unasked, free=True) == cells(good, free=True)
    with pytest.raises(InputError, match=rf"frame {names[3]}: unfamiliar \(--strict stops here\)"):
        map_recording(Given(list), config=TRUTH, segmenter=Doubter(names[3:]), strict=True)
    strange = Doubter(names[:1])(source.frames[0])
    frame = source.frames[0]
    look = with_mask(Looker(TRUTH.watchdog).see(0, frame), frame, strange, None, TRUTH.watchdog)
    assert watchdog_of([{"looks": look}], TRUTH.watchdog)["faults"] == {"unfamiliar": 1}


def test_simulators_without_noise_may_repeat_themselves() -> None:
    config = config_from_dict(
        {"segmenter": {"name": "truth"}, "output": {"pictures": 0}, "watchdog": {"frozen_s": None}}
    )
    assert map_recording(Given(frozen), config=config).summary["frames"] == 6
    same = [{"looks": {"faults": [], "prints": [1, 2]}}] * 3
    assert watchdog_of(same, WatchdogConfig(frozen_s=None))["faults"] == {}


def test_the_command_tells_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_folder(Given(frozen), tmp_path / "rec")
    command = ["map", str(tmp_path / "rec"), "-o", str(tmp_path / "out"), "--segmenter", "truth"]
    assert run([*command, "--strict"]) == 1
    assert "frozen (--strict stops here)" in capsys.readouterr().err
    assert run(command) == 0
    assert "not mapped, as the node would not: 5 x frozen" in capsys.readouterr().out


def test_an_evaluation_counts_them_and_strict_stops(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_folder(Given(at([3], black)), tmp_path / "rec")
    command = ["evaluate", str(tmp_path / "rec"), "--segmenter", "truth", "--workers", "1", "--no-budget",
               "--resolution", "0.1"]  # fmt: skip
    assert run([*command, "-o", str(tmp_path / "out")]) == 0
    assert "frames that the watchdog of the node would name: 1 x black" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "results.json").read_text())["faults"] == {"black": 1}
    assert run([*command, "-o", str(tmp_path / "strict"), "--strict"]) == 1
    assert "frame 3: black (--strict stops here)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("count", "since"), [(6, 1), (9, 8)], ids=["in a part", "over the edge of two parts"]
)
def test_an_evaluation_stops_at_a_frozen_frame(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], count: int, since: int
) -> None:
    def held(frames: Sequence[Frame]) -> list[Frame]:
        last = frames[since - 1]
        same = [replace(f, rgb=last.rgb, depth=last.depth, labels=last.labels) for f in frames[since:]]
        return [*frames[:since], *same]

    write_folder(Given(held, count), tmp_path / "rec")
    command = ["evaluate", str(tmp_path / "rec"), "--segmenter", "truth", "--workers", "1", "--no-budget",
               "--resolution", "0.2"]  # fmt: skip
    assert run([*command, "-o", str(tmp_path / "out"), "--strict"]) == 1
    assert f"frame {since}: frozen (--strict stops here)" in capsys.readouterr().err
    assert not (tmp_path / "out" / "results.json").exists()
