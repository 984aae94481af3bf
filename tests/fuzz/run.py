"""Throws damaged files at every reader: `make fuzz`, or python -m tests.fuzz.run SECONDS [SEED] [READER ...].

A reader may return or raise a SwardmapError. Anything else is a failure: another exception, more than 5
seconds, or more than a gigabyte. Failing inputs are kept in fuzz_failures/.
"""

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
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path
from types import FrameType

from swardmap.errors import SwardmapError
from tests.fuzz.mutate import mutated
from tests.fuzz.readers import Reader, placed, readers

MAX_SECONDS = 5
MAX_BYTES = 2**30
KEPT = 5
"""Failing inputs that are kept of each reader."""


class TooSlowError(BaseException):
    """No reader may catch it."""


def _too_slow(_: int, __: FrameType | None) -> None:
    raise TooSlowError


def failure_of(reader: Reader, path: Path) -> str:
    """What is wrong with how a reader takes a file; empty if nothing is."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.setitimer(signal.ITIMER_REAL, MAX_SECONDS)
    try:
        reader.read(path)
    except SwardmapError as error:
        if len(str(error).splitlines()) > 1:
            return "a message of several lines"
    except TooSlowError:
        return f"more than {MAX_SECONDS} s"
    except Exception as error:  # noqa: BLE001 - that is what is looked for
        last = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} {Path(last.filename).name}:{last.lineno}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    return f"{grown / 1e9:.1f} GB" if grown > MAX_BYTES else ""


def fuzz(name: str, reader: Reader, seconds: float, seed: int, keep: Path) -> tuple[int, Counter[str]]:
    """Damage good files of one reader for a time; number of cases, and failures by their kind."""
    signal.signal(signal.SIGALRM, _too_slow)
    warnings.simplefilter("ignore")
    dice, failures, cases = random.Random(f"{seed} {name}"), Counter[str](), 0
    everything = list(reader.good)
    with tempfile.TemporaryDirectory() as folder:
        here, end = Path(folder) / "case", time.monotonic() + seconds
        for content in reader.good:
            if what := failure_of(reader, placed(reader, content, here)):
                failures[f"of a good file: {what}"] += 1
        while time.monotonic() < end:
            content = mutated(dice.choice(reader.good), dice, everything)
            what = failure_of(reader, placed(reader, content, here))
            cases += 1
            if what:
                failures[what] += 1
                if failures[what] <= KEPT:
                    keep.mkdir(parents=True, exist_ok=True)
                    (
                        keep / f"{name.replace(' ', '_').replace('/', '_')}-{seed}-{cases}{reader.suffix}"
                    ).write_bytes(content)
    return cases, failures


def _one(job: tuple[str, float, int]) -> tuple[str, int, dict[str, int]]:
    name, seconds, seed = job
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # decoders complain in C
    cases, failures = fuzz(name, _readers[name], seconds, seed, Path("fuzz_failures"))
    return name, cases, dict(failures)


_readers: dict[str, Reader] = {}
"""Made once; processes inherit them."""


def fuzz_all(
    seconds: float, seed: int = 0, names: Sequence[str] = ()
) -> dict[str, tuple[int, dict[str, int]]]:
    """Fuzz all readers, or those named, for so many seconds together.

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
        jobs = [(name, seconds * workers / len(chosen), seed) for name in chosen]
        with get_context("fork").Pool(workers, maxtasksperchild=1) as pool:
            for name, cases, failures in pool.imap_unordered(_one, jobs):
                found[name] = cases, failures
                told = ", ".join(f"{n} x {what}" for what, n in failures.items()) or "no failure"
                print(f"{name:24}{cases:8} cases  {told}", flush=True)  # noqa: T201
    return found


def main(arguments: Sequence[str]) -> int:
    """Fuzz as the command line says; prints a line for each reader."""
    seed = int(arguments[1]) if len(arguments) > 1 else 0
    found = fuzz_all(float(arguments[0]), seed, arguments[2:])
    cases = sum(count for count, _ in found.values())
    bad = sum(sum(failures.values()) for _, failures in found.values())
    print(f"{cases} cases of {len(found)} readers, {bad} failures")  # noqa: T201
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
