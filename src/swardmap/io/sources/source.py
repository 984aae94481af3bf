"""What all sources that are read share: what is known of them, and the count of what they leave out."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from swardmap.io.sources.truth import FrameTruth
from swardmap.labels import LabelSet
from swardmap.types import Frame


@dataclass(slots=True)
class Tally:
    """What one pass through a source left out.

    Attributes:
        skipped: how often each reason came.
        first: the first of each reason in full, where there is more to say than the reason.
        notes: readings that were taken for granted, each once.
        facts: what else a person should see to believe the run: plain dicts, lists, strings, numbers, or a
            function that gives them when they are asked for.
    """

    skipped: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)

    def skip(self, reason: str, detail: str = "", count: int = 1) -> None:
        """Count what was left out."""
        self.skipped[reason] += count
        if detail:
            self.first.setdefault(reason, detail)

    def note(self, text: str) -> None:
        """Say once what was taken for granted."""
        if text not in self.notes:
            self.notes.append(text)


def tally_facts(tally: Tally) -> dict[str, Any]:
    """The facts of a pass, what was left out (how often, the first in full) and taken for granted."""
    left_out = {
        reason: {"count": count} | ({"first": tally.first[reason]} if reason in tally.first else {})
        for reason, count in tally.skipped.items()
        if count
    }
    facts = {name: value() if callable(value) else value for name, value in tally.facts.items()}
    return {**facts, "left_out": left_out, "notes": list(tally.notes)}


@dataclass(slots=True)
class Source:
    """Frames that can be read again from the beginning; see `swardmap.io.FrameSource`.

    Attributes:
        name: what a person would call it.
        frame_count: at most; frames that miss a part are counted in `skipped` and not yielded.
        label_set: classes of the true labels, or None.
        read: yields the frames in order of time, and counts in its argument what it leaves out.
        tally: of the last iteration so far.
        clean_frame: the frame at a position with exact depth, for evaluations; None where there is none.
        truth: what is truly there in the frame at a position; None where nobody recorded it.
    """

    name: str
    frame_count: int | None
    label_set: LabelSet | None
    read: Callable[[Tally], Iterator[Frame]]
    tally: Tally = field(default_factory=Tally)
    clean_frame: Callable[[int], Frame | None] = lambda _: None
    truth: Callable[[int], FrameTruth | None] = lambda _: None

    @property
    def skipped(self) -> dict[str, int]:
        """What the last iteration left out so far, by reason."""
        return {reason: count for reason, count in self.tally.skipped.items() if count}

    @property
    def notes(self) -> list[str]:
        """What the last iteration took for granted so far, each reading once."""
        return list(self.tally.notes)

    @property
    def facts(self) -> dict[str, Any]:
        """What the last iteration found out so far, for summary.json and a person's eye."""
        return tally_facts(self.tally)

    def __iter__(self) -> Iterator[Frame]:
        """Read from the beginning."""
        self.tally = Tally()
        return self.read(self.tally)
