"""Intervals of shares by sequence, against SciPy where cases are independent and by simulation where not."""

import numpy as np
import pytest
from scipy.stats import binomtest

from swardmap.errors import InvalidValueError
from swardmap.eval.intervals import share_interval


def test_with_many_sequences_of_one_case_it_is_the_exact_interval() -> None:
    hits = [1.0] * 13 + [0.0] * 387
    found = share_interval(hits, [1.0] * 400)
    exact = binomtest(13, 400).proportion_ci(0.95, "exact")
    assert found is not None
    assert found.low == pytest.approx(exact.low, abs=0.001)
    assert found.high == pytest.approx(exact.high, abs=0.001)


def test_cases_that_come_together_count_less() -> None:
    together = share_interval([10.0, 0, 0, 0, 0, 0, 0, 0], [10.0] * 8)
    apart = share_interval([2.0, 1, 1, 1, 1, 1, 1, 2], [10.0] * 8)
    assert together is not None
    assert apart is not None
    assert together.high - together.low > 1.5 * (apart.high - apart.low)


def test_nothing_missed_counts_sequences_and_not_things() -> None:
    found = share_interval([0.0] * 20, [33.0] * 20)
    assert found is not None
    assert found.low == 0
    assert found.high == pytest.approx(binomtest(0, 20).proportion_ci(0.95, "exact").high)
    full = share_interval([33.0] * 20, [33.0] * 20)
    assert full is not None
    assert full.low == pytest.approx(1 - found.high)
    assert full.high == 1


def test_one_sequence_has_none_and_empty_ones_do_not_count() -> None:
    assert share_interval([1.0], [10.0]) is None
    assert share_interval([1.0, 0.0], [10.0, 0.0]) is None
    assert share_interval([], []) is None
    with pytest.raises(InvalidValueError, match="confidence"):
        share_interval([1.0, 0.0], [2.0, 2.0], 95)


def test_it_holds_the_share_as_often_as_it_says() -> None:
    """Sequences of 30 things whose own shares are spread about 5 % by a beta distribution."""
    rng, held = np.random.default_rng(0), 0
    for _ in range(300):
        shares = rng.beta(0.5, 9.5, 25)
        found = share_interval(rng.binomial(30, shares).tolist(), [30.0] * 25)
        held += found is not None and found.low <= 0.05 <= found.high
    assert held / 300 > 0.92
