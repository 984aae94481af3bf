"""Throws damaged files at every reader: `make fuzz`, or by hand

    python -m tests.fuzz.run SECONDS [SEED] [READER ...]
    python -m tests.fuzz.run 20000x [SEED] [READER ...]

for so many seconds together, or so many cases of each reader.

A reader may return or raise a SwardmapError. Anything else is a failure: another exception, more than 5
seconds of the processor, a minute of waiting, or more than a gigabyte. What is too slow is tried again: a
machine that has other work, or too little memory, is no fault of a reader. Failing inputs are kept in
fuzz_failures/, and how they failed is told in full.
"""

import math
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from types import FrameType

from swardmap.errors import SwardmapError, one_line
from tests.fuzz.mutate import mutated
from tests.fuzz.readers import Reader, placed, readers

MAX_SECONDS = 5.0
"""Of the processor, which other programs cannot use up."""
MAX_WAITING_SECONDS = 60.0
"""By the clock: for a reader that waits, as for the other end of a FIFO."""
SLOW_TRIES = 2
MAX_BYTES = 2**30
KEPT = 5
"""Failing inputs that are kept of each reader."""


class TooSlowError(BaseException):
    """No reader may catch it."""


def _too_slow(_: int, __: FrameType | None) -> None:
    raise TooSlowError


def failure_of(reader: Reader, path: Path, seconds: float = MAX_SECONDS) -> str:
    """What is wrong with how a reader takes a file; empty if nothing is.

    Args:
        reader: to try.
        path: of the file.
        seconds: of the processor that it may take; twelve times as many may pass by the clock.
    """
    for _ in range(SLOW_TRIES):
        what = _tried(reader, path, seconds)
        if not what.startswith("more than"):
            break
    return what


def _tried(reader: Reader, path: Path, seconds: float) -> str:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    waiting = seconds / MAX_SECONDS * MAX_WAITING_SECONDS
    try:
        with _limits(seconds, waiting):
            reader.read(path)
    except SwardmapError as error:
        if len(str(error).splitlines()) > 1:
            return "a message of several lines"
    except TooSlowError as error:
        return f"more than {seconds:g} s of the processor or {waiting:g} s in {_place(error)}"
    except Exception as error:  # noqa: BLE001 - that is what is looked for
        return f"{type(error).__name__} {_place(error)}: {one_line(error, 100)}"
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    return f"{grown / 1e9:.1f} GB" if grown > MAX_BYTES else ""


@contextmanager
def _limits(seconds: float, waiting: float) -> Iterator[None]:
    """Raise TooSlowError after so many seconds of the processor, or by the clock."""
    kinds = ((signal.SIGPROF, signal.ITIMER_PROF, seconds), (signal.SIGALRM, signal.ITIMER_REAL, waiting))
    before = [(number, signal.signal(number, _too_slow)) for number, _, _ in kinds]
    left = [(timer, signal.setitimer(timer, limit)[0]) for _, timer, limit in kinds]
    try:
        yield
    finally:
        for timer, _ in left:
            signal.setitimer(timer, 0)
        for number, handler in before:
            signal.signal(number, handler)
        for timer, rest in left:  # such as the one of a test that is timed itself
            signal.setitimer(timer, rest)


def _place(error: BaseException) -> str:
    """Where an error comes from: our last line, and the last of all."""
    steps = [s for s in traceback.extract_tb(error.__traceback__) if s.name != _too_slow.__name__]
    ours = [step for step in steps if "swardmap" in Path(step.filename).parts[:-1]]
    return " > ".join(
        dict.fromkeys(f"{Path(step.filename).name}:{step.lineno}" for step in (*ours[-1:], steps[-1]))
    )


def fuzz(
    name: str, reader: Reader, seconds: float, most: float, seed: int, keep: Path
) -> tuple[int, Counter[str]]:
    """Damage good files of one reader for a time, or so many times; cases, and failures by their kind."""
    warnings.simplefilter("ignore")
    dice, failures, cases = random.Random(f"{seed} {name}"), Counter[str](), 0
    everything = list(reader.good)
    with tempfile.TemporaryDirectory() as folder:
        here, end = Path(folder) / "case", time.monotonic() + seconds
        for content in reader.good:
            if what := failure_of(reader, placed(reader, content, here)):
                failures[f"of a good file: {what}"] += 1
        while time.monotonic() < end and cases < most:
            content = mutated(dice.choice(reader.good), dice, everything)
            what = failure_of(reader, placed(reader, content, here))
            cases += 1
            if what:
                failures[what] += 1
                if failures[what] <= KEPT:
                    keep.mkdir(parents=True, exist_ok=True)
                    plain = name.replace(" ", "_").replace("/", "_")
                    (keep / f"{plain}-{seed}-{cases}{reader.suffix}").write_bytes(content)
    return cases, failures


def _one(job: tuple[str, float, float, int]) -> tuple[str, int, dict[str, int]]:
    name, seconds, most, seed = job
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # decoders complain in C
    cases, failures = fuzz(name, _readers[name], seconds, most, seed, Path("fuzz_failures"))
    return name, cases, dict(failures)


_readers: dict[str, Reader] = {}
"""Made once; processes inherit them."""


def fuzz_all(
    seconds: float, most: float = math.inf, seed: int = 0, names: Sequence[str] = ()
) -> dict[str, tuple[int, dict[str, int]]]:
    """Fuzz all readers, or those named, for so many seconds together, or with so many cases each.

    Returns:
        Reader -> number of cases, and failures by their kind.
    """
    import cv2

    cv2.setNumThreads(1)  # a process with threads cannot be forked safely
    found = {}
    with tempfile.TemporaryDirectory() as corpus:
        _readers.update(readers(Path(corpus)))
        workers = len(os.sched_getaffinity(0))
        chosen = list(names) or list(_readers)
        if strange := set(chosen) - set(_readers):
            raise SystemExit(f"expected readers of {', '.join(_readers)}; got {', '.join(sorted(strange))}")
        jobs = [(name, seconds * workers / len(chosen), most, seed) for name in chosen]
        with get_context("fork").Pool(workers, maxtasksperchild=1) as pool:
            for name, cases, failures in pool.imap_unordered(_one, jobs):
                found[name] = cases, failures
                told = ", ".join(f"{n} x {what}" for what, n in failures.items()) or "no failure"
                print(f"{name:24}{cases:8} cases  {told}", flush=True)  # noqa: T201
    return found


def main(arguments: Sequence[str]) -> int:
    """Fuzz as the command line says; prints a line for each reader."""
    seed = int(arguments[1]) if len(arguments) > 1 else 0
    much = arguments[0]
    limits = (math.inf, int(much[:-1])) if much.endswith("x") else (float(much), math.inf)
    found = fuzz_all(limits[0], limits[1], seed, arguments[2:])
    cases = sum(count for count, _ in found.values())
    bad = sum(sum(failures.values()) for _, failures in found.values())
    print(f"{cases} cases of {len(found)} readers, {bad} failures")  # noqa: T201
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
