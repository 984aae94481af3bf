"""The one-pass pairing against the definition, tried on all pairs at once."""

from hypothesis import given
from hypothesis import strategies as st

from swardmap.io.pairing import COLOR, DEPTH, REASON_COLOR, REASON_DEPTH, REASON_ORDER, Pairer

stamps = st.lists(st.integers(0, 400), unique=True, max_size=30).map(sorted)


def run(
    events: list[tuple[str, int]], tolerance: int, limit: int = 60
) -> tuple[list[tuple[int, int]], Pairer[int]]:
    pairer: Pairer[int] = Pairer(tolerance, limit)
    pairs = [(p.color, p.depth) for kind, t in events for p in pairer.add(kind, t, t)]
    pairs += [(p.color, p.depth) for p in pairer.flush()]
    return pairs, pairer


def neighbours(colors: list[int], depths: list[int], tolerance: int) -> list[tuple[int, int]]:
    """Nothing between the two, and what is beside either is not nearer to it (on a tie: colour first)."""
    pairs = []
    for c in colors:
        for d in depths:
            low, high = min(c, d), max(c, d)
            between = [t for t in colors + depths if low < t < high]
            # an image of both kinds at one end already is the nearer pair
            doubled = c != d and (c in depths or d in colors)
            before = [low - t for t in (colors if low == d else depths) if t < low]
            after = [t - high for t in (depths if high == c else colors) if t > high]
            # only what stands beside: nothing else comes closer from that side
            beside_before = [low - t for t in colors + depths if t < low]
            beside_after = [t - high for t in colors + depths if t > high]
            gap = high - low
            worse = 0.5 if d < c else 0.0  # depth first loses ties
            rivals = [
                min(sames)
                for sames, near in ((before, beside_before), (after, beside_after))
                if sames and min(sames) == min(near)
            ]
            if (
                not between
                and not doubled
                and gap <= tolerance
                and all(gap + worse < r + 0.25 for r in rivals)
            ):
                pairs.append((c, d))
    return pairs


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
