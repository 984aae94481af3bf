"""Frames read and segmented ahead: what comes out is what one thread gives, and nothing is left running."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import swardmap
from swardmap.config import SegmenterConfig, config_from_dict
from swardmap.errors import InputError, InvalidValueError
from swardmap.io import open_source
from swardmap.models import build_segmenter
from swardmap.models.onnx import OnnxSegmenter, default_threads
from swardmap.runs.ahead import WAITING, in_order, network_plan
from swardmap.runs.recording import map_recording
from swardmap.types import Frame, Segmentation

DEMO = Path(swardmap.__file__).parent / "data" / "demo"


def numbers(n: int) -> Iterator[int]:
    yield from range(n)


def slow_square(i: int) -> int:
    time.sleep(0.002 * (i % 3))  # later ones are often ready first
    return i * i


def threads_now() -> set[str]:
    return {t.name for t in threading.enumerate() if t.name.startswith(("read", "segment"))}


@pytest.mark.parametrize("workers", [0, 1, 4])
def test_results_come_in_the_order_of_the_items(workers: int) -> None:
    found = list(in_order(lambda: numbers(30), slow_square, workers))
    assert found == [(i, i * i) for i in range(30)]
    assert threads_now() == set()


def test_an_error_comes_in_its_turn_and_nothing_runs_on() -> None:
    def work(i: int) -> int:
        if i == 3:
            raise InputError("bad frame")
        return i

    def broken(n: int) -> Iterator[int]:
        yield from range(n)
        raise InputError("the recording ends here")

    for read, count in ((lambda: numbers(9), 3), (lambda: broken(2), 2)):
        found = in_order(read, work, 2)
        assert [next(found)[0] for _ in range(count)] == list(range(count))
        with pytest.raises(InputError):
            next(found)
        assert threads_now() == set()
    with pytest.raises(InputError, match="cannot open"):
        next(in_order(lambda: (_ for _ in ()).throw(InputError("cannot open")), work, 2))


def test_reading_is_bounded_and_happens_in_one_thread_from_beginning_to_end() -> None:
    where, began = set(), []

    def read() -> Iterator[int]:
        try:
            for i in range(100):
                where.add(threading.get_ident())
                began.append(i)
                yield i
        finally:
            where.add(threading.get_ident())

    taken = in_order(read, lambda i: i, 2)
    assert next(taken)[0] == 0
    time.sleep(0.1)
    assert len(began) <= 1 + 2 + WAITING + 2
    taken.close()  # type: ignore[attr-defined]
    assert threads_now() == set()
    assert len(where) == 1
    assert where != {threading.get_ident()}


def test_cores_are_used_by_a_rule() -> None:
    assert [network_plan(SegmenterConfig(), n) for n in (1, 2, 4, 8, 32)] == [
        (1, 1), (2, 1), (4, 1), (8, 1), (8, 1)
    ]  # fmt: skip
    assert network_plan(SegmenterConfig(threads=3), 8) == (1, 3)
    assert network_plan(SegmenterConfig(provider="CUDAExecutionProvider"), 8) == (1, 0)


@pytest.mark.parametrize(("cores", "threads"), [(1, 1), (2, 2), (4, 4), (8, 4)])
def test_a_live_network_takes_a_thread_a_core(
    cores: int, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(cores)))
    assert default_threads() == threads


def test_a_map_is_the_same_to_the_last_cell(tmp_path: Path) -> None:
    config = config_from_dict({"source": {"stop": 5}, "output": {"pictures": 0}})
    ahead, alone = (map_recording(DEMO, tmp_path / str(a), config, ahead=a) for a in (True, False))
    assert ahead.grid is not None
    assert alone.grid is not None
    np.testing.assert_array_equal(ahead.grid.classes, alone.grid.classes)
    assert ahead.totals.pixels == alone.totals.pixels
    same = ("frames", "pixels", "map", "ground", "skipped", "watchdog", "mount")
    assert {k: ahead.summary[k] for k in same} == {k: alone.summary[k] for k in same}
    for name in ("map.pgm", "costmap_costs.pgm"):
        assert (tmp_path / "True" / name).read_bytes() == (tmp_path / "False" / name).read_bytes()


def test_a_network_says_the_same_from_any_thread_and_with_any_number_of_them() -> None:
    frames = list(open_source(DEMO, config_from_dict({"source": {"stop": 3}})))
    one, two = (build_segmenter(SegmenterConfig(threads=n)) for n in (1, 2))
    assert isinstance(one, OnnxSegmenter)
    assert one.concurrent
    expected = [one(frame) for frame in frames]
    for other in ([two(f) for f in frames], [s for _, s in in_order(lambda: iter(frames), one, 3)]):
        for a, b in zip(expected, other, strict=True):
            np.testing.assert_array_equal(a.labels, b.labels)
            np.testing.assert_array_equal(a.confidence, b.confidence)


def test_a_segmenter_that_does_not_say_so_is_called_by_one_thread() -> None:
    callers = set()

    class Careful:
        name, label_set = "careful", build_segmenter(SegmenterConfig(name="colour")).label_set

        def __call__(self, frame: Frame) -> Segmentation:
            callers.add(threading.get_ident())
            return Segmentation(np.zeros(frame.rgb.shape[:2], np.uint8), self.label_set)

    map_recording(DEMO, config=config_from_dict({"source": {"stop": 3}}), segmenter=Careful())
    assert callers == {threading.get_ident()}


def test_a_segmenter_that_gives_a_bare_array_is_one_clear_line() -> None:
    class Bare:
        name, label_set = "bare", build_segmenter(SegmenterConfig(name="colour")).label_set

        def __call__(self, frame: Frame) -> np.ndarray:
            return np.zeros(frame.rgb.shape[:2], np.uint8)

    with pytest.raises(InvalidValueError, match=r"'bare': expected a Segmentation, got ndarray; return Segm"):
        map_recording(DEMO, config=config_from_dict({"source": {"stop": 1}}), segmenter=Bare())  # type: ignore[arg-type]
