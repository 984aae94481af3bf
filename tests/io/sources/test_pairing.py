"""The one-pass pairing against the definition, tried on all pairs at once."""

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from swardmap.io.sources.pairing import COLOR, DEPTH, REASON_COLOR, REASON_DEPTH, REASON_ORDER, Pairer

stamps = st.lists(st.integers(0, 400), unique=True, max_size=30).map(sorted)


def run(
    events: list[tuple[str, int]], tolerance: int, limit: int = 60
) -> tuple[list[tuple[int, int]], Pairer[int]]:
    pairer: Pairer[int] = Pairer(tolerance, limit)
    pairs = [(p.color, p.depth) for kind, t in events for p in pairer.add(kind, t, t)]
    pairs += [(p.color, p.depth) for p in pairer.flush()]
    return pairs, pairer


def neighbours(colors: list[int], depths: list[int], tolerance: int) -> list[tuple[int, int]]:
    """The definition, on all images at once: side by side in time, and no nearer partner on the other side.

    Of two images at the same time the colour image stands first; of two gaps as large, the one that
    begins with a colour image is the smaller.
    """
    line = sorted([(t, 0) for t in colors] + [(t, 1) for t in depths])
    gaps = [(b[0] - a[0], a[1]) if a[1] != b[1] else (10**9, 0) for a, b in pairwise(line)]
    pairs = []
    for i, gap in enumerate(gaps):
        others = gaps[max(i - 1, 0) : i] + gaps[i + 1 : i + 2]
        if gap[0] <= tolerance and all(gap < other for other in others):
            color, depth = sorted(line[i : i + 2], key=lambda image: image[1])
            pairs.append((color[0], depth[0]))
    return pairs


@settings(max_examples=300)
@given(colors=stamps, depths=stamps, tolerance=st.integers(0, 60), data=st.data())
def test_equals_the_definition_whatever_the_arrival(
    colors: list[int], depths: list[int], tolerance: int, data: st.DataObject
) -> None:
    left, right = list(colors), list(depths)
    events = []
    while left or right:  # any interleaving of the two streams
        take_color = bool(left) and (not right or data.draw(st.booleans()))
        events.append((COLOR, left.pop(0)) if take_color else (DEPTH, right.pop(0)))
    pairs, pairer = run(events, tolerance)
    assert pairs == neighbours(colors, depths, tolerance)
    assert pairer.skipped == {
        REASON_COLOR: len(colors) - len(pairs),
        REASON_DEPTH: len(depths) - len(pairs),
        REASON_ORDER: 0,
    }


@given(
    events=st.lists(st.tuples(st.sampled_from([COLOR, DEPTH]), st.integers(0, 200))),
    limit=st.integers(1, 5),
)
def test_any_order_keeps_the_promises(events: list[tuple[str, int]], limit: int) -> None:
    pairs, pairer = run(events, 20, limit)
    assert pairs == sorted(pairs)
    assert len({c for c, _ in pairs}) == len({d for _, d in pairs}) == len(pairs)
    assert all(abs(c - d) <= 20 for c, d in pairs)
    assert sum(pairer.skipped.values()) + 2 * len(pairs) == len(events)


def test_streams_half_a_period_apart_pair() -> None:
    events = sorted([(t, COLOR) for t in range(0, 200, 20)] + [(t, DEPTH) for t in range(10, 210, 20)])
    pairs, _ = run([(kind, t) for t, kind in events], 10)
    assert pairs == [(t, t + 10) for t in range(0, 200, 20)]


def test_a_stream_that_stops_does_not_fill_the_memory() -> None:
    pairer: Pairer[int] = Pairer(20, limit=10)
    for t in range(1000):
        assert list(pairer.add(COLOR, t, t)) == []
        assert len(pairer._waiting[COLOR]) <= 10
    assert pairer.skipped[REASON_COLOR] >= 980


def test_a_clock_that_goes_back_is_counted() -> None:
    pairs, pairer = run([(COLOR, 100), (DEPTH, 100), (COLOR, 50), (DEPTH, 50), (COLOR, 200), (DEPTH, 201)], 5)
    assert pairs == [(100, 100), (200, 201)]
    assert pairer.skipped[REASON_ORDER] == 2
