"""Which depth image belongs to which colour image: by time, in one pass, with bounded memory."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")

COLOR, DEPTH = "color", "depth"

REASON_COLOR = "colour image without a depth image near in time"
REASON_DEPTH = "depth image without a colour image near in time"
REASON_ORDER = "image not later than the one before it"


@dataclass(frozen=True, slots=True)
class _Image(Generic[Item]):
    kind: str
    stamp_ns: int
    item: Item


@dataclass(frozen=True, slots=True)
class Pair(Generic[Item]):
    """A colour image and the depth image that belongs to it, each with its time."""

    stamp_ns: int
    color: Item
    depth: Item
    depth_stamp_ns: int


class Pairer(Generic[Item]):
    """Pairs two streams of images: neighbours in time, neither with a nearer neighbour on its other side.

    No image is used twice, pairs come in order of time, and no choice depends on how far one stream
    runs ahead of the other. At the same time the colour image counts as first. Of two depth images as
    near, the later is taken (of colour the earlier), so that streams half a period apart still pair.

    Args:
        tolerance_ns: largest distance in time.
        limit: images held of each stream; beyond it the other stream counts as absent.

    Attributes:
        skipped: images left out, by reason.
        first: the first of each reason in full.
    """

    def __init__(self, tolerance_ns: int, limit: int = 60) -> None:
        self.skipped = {REASON_COLOR: 0, REASON_DEPTH: 0, REASON_ORDER: 0}
        self.first: dict[str, str] = {}
        self._tolerance_ns = tolerance_ns
        self._limit = limit
        self._waiting: dict[str, deque[_Image[Item]]] = {COLOR: deque(), DEPTH: deque()}
        self._newest: dict[str, int] = {}
        self._spans: dict[str, tuple[int, int]] = {}
        self._merged_ns: int | None = None
        self._chain: deque[_Image[Item]] = deque()  # the last images in order of time, not yet decided
        self._gap_before: tuple[float, int] = (float("inf"), 0)

    def add(self, kind: str, stamp_ns: int, item: Item) -> Iterator[Pair[Item]]:
        """Take the next image of one stream.

        Args:
            kind: COLOR or DEPTH.
            stamp_ns: its time; an image not later than the one before it is left out and counted.
            item: whatever is to be paired.

        Yields:
            The pairs that are now certain.
        """
        first, last = self._spans.get(kind, (stamp_ns, stamp_ns))
        self._spans[kind] = min(first, stamp_ns), max(last, stamp_ns)
        before = self._newest.get(kind)
        late = self._merged_ns is not None and stamp_ns < self._merged_ns
        if late or (before is not None and stamp_ns <= before):
            self.skipped[REASON_ORDER] += 1
            newest = max(t for t in (before, self._merged_ns) if t is not None) / 1e9
            said = f"the {kind} image of {stamp_ns / 1e9:.3f} s came after one of {newest:.3f} s"
            self.first.setdefault(REASON_ORDER, said)
            return
        self._newest[kind] = stamp_ns
        self._waiting[kind].append(_Image(kind, stamp_ns, item))
        colors, depths = self._waiting[COLOR], self._waiting[DEPTH]
        while (colors and depths) or max(len(colors), len(depths)) > self._limit:
            yield from self._follow(self._earliest())

    def apart(self) -> str:
        """The times of both streams, in seconds, if they have none in common; else empty."""
        if len(self._spans) < len(self._waiting):
            return ""
        spans = [self._spans[kind] for kind in (COLOR, DEPTH)]
        (a, b), (c, d) = spans
        if a <= d + self._tolerance_ns and c <= b + self._tolerance_ns:
            return ""
        color, depth = (f"{first / 1e9:.3f} to {last / 1e9:.3f} s" for first, last in spans)
        return f"colour images are of {color}, depth images of {depth}"

    def flush(self) -> Iterator[Pair[Item]]:
        """Yield what is left when both streams have ended."""
        while any(self._waiting.values()):
            yield from self._follow(self._earliest())
        yield from self._decide(until=0)

    def _earliest(self) -> _Image[Item]:
        """Take the next image in order of time; of two at the same time the colour image is first."""
        colors, depths = self._waiting[COLOR], self._waiting[DEPTH]
        first = colors if colors and (not depths or colors[0].stamp_ns <= depths[0].stamp_ns) else depths
        image = first.popleft()
        self._merged_ns = image.stamp_ns
        return image

    def _follow(self, image: _Image[Item]) -> Iterator[Pair[Item]]:
        self._chain.append(image)
        yield from self._decide(until=2)

    def _decide(self, until: int) -> Iterator[Pair[Item]]:
        """Pair or drop the first image of the chain while `until` images stay to compare with.

        A pair is two neighbours of the chain whose gap is smaller than the gaps on both sides.
        """
        while len(self._chain) > until:
            first = self._chain.popleft()
            if not self._chain:
                self._leave(first, self._gap_before[0])
                return
            gap = self._gap(first, self._chain[0])
            after = self._gap(*list(self._chain)[:2]) if len(self._chain) > 1 else (float("inf"), 0)
            if gap[0] <= self._tolerance_ns and self._gap_before > gap < after:
                second = self._chain.popleft()
                color, depth = (first, second) if first.kind == COLOR else (second, first)
                self._gap_before = after
                yield Pair(color.stamp_ns, color.item, depth.item, depth.stamp_ns)
            else:
                self._leave(first, min(gap[0], self._gap_before[0]))
                self._gap_before = gap

    def _gap(self, first: _Image[Item], second: _Image[Item]) -> tuple[float, int]:
        """What to compare: the time between, and for equal times the order; infinite for equal kinds."""
        if first.kind == second.kind:
            return float("inf"), 0
        return second.stamp_ns - first.stamp_ns, int(first.kind == DEPTH)

    def _leave(self, image: _Image[Item], nearest_ns: float) -> None:
        reason = REASON_COLOR if image.kind == COLOR else REASON_DEPTH
        self.skipped[reason] += 1
        where = (
            "no neighbour" if nearest_ns == float("inf") else f"the nearest is {nearest_ns / 1e6:.1f} ms away"
        )
        said = f"the {image.kind} image of {image.stamp_ns / 1e9:.3f} s: {where} (source.pair_tolerance_ms)"
        self.first.setdefault(reason, said)


def pairing_facts(offsets_ns: Sequence[int]) -> dict[str, Any]:
    """How far apart in time the images of pairs are, for summary.json."""
    if not offsets_ns:
        return {"pairs": 0}
    middle, worst = median(offsets_ns) / 1e6, max(offsets_ns) / 1e6
    return {"pairs": len(offsets_ns), "median_ms": round(middle, 3), "worst_ms": round(worst, 3)}
