import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.errors import InvalidValueError
from swardmap.eval.distances import DistanceHistogram, exact_share

histograms = st.dictionaries(st.integers(0, 4000), st.integers(1, 30), max_size=20)


def expanded(counts: dict[int, int], resolution_m: float = 0.05) -> list[float]:
    return sorted(math.sqrt(k) * resolution_m for k, n in counts.items() for _ in range(n))


@given(histograms.filter(bool))
def test_summary_is_that_of_the_distances_written_out(counts: dict[int, int]) -> None:
    distances = expanded(counts)
    summary = DistanceHistogram(0.05, counts).summary()
    assert summary.count == len(distances)
    assert summary.mean_m == pytest.approx(np.mean(distances), rel=1e-12)
    assert summary.variance_m2 == pytest.approx(np.var(distances), rel=1e-9, abs=1e-15)
    assert summary.max_m == distances[-1]
    for q, value in summary.quantiles_m.items():
        k = math.ceil(Fraction(str(q)) * len(distances))
        assert value == distances[k - 1]
        assert value == pytest.approx(np.quantile(distances, q - 1e-9, method="inverted_cdf"))


@given(histograms, st.integers(1, 5), st.randoms(use_true_random=False))
def test_any_split_gives_the_same_digits(counts: dict[int, int], parts: int, random: object) -> None:
    whole = DistanceHistogram(0.05, counts)
    shards: list[dict[int, int]] = [{} for _ in range(parts)]
    for key, n in counts.items():
        for _ in range(n):
            shard = random.choice(shards)  # type: ignore[attr-defined]
            shard[key] = shard.get(key, 0) + 1
    merged = DistanceHistogram(0.05, {})
    for shard in shards:
        merged = DistanceHistogram(0.05, shard) + merged
    assert merged == whole
    assert repr(merged.summary()) == repr(whole.summary())


@given(histograms, st.sampled_from([0.02, 0.05, 0.1]))
def test_bins_hold_every_distance_once(counts: dict[int, int], width: float) -> None:
    histogram = DistanceHistogram(0.05, counts)
    bins = histogram.bins(width)
    assert sum(n for *_, n in bins) == histogram.count
    distances = np.array(expanded(counts))
    for i, (low, high, n) in enumerate(bins):
        inside = (distances > low + 1e-9) & (distances <= high + 1e-9)
        if i == 0:
            inside |= distances == 0
        assert n == inside.sum()


@given(histograms.filter(bool))
def test_the_quantile_covers_its_share_and_nothing_smaller_does(counts: dict[int, int]) -> None:
    histogram = DistanceHistogram(0.05, counts)
    for share in (0.01, 0.5, 0.99, 1.0):
        value = histogram.quantile_m(share)
        assert value is not None
        wanted = exact_share(share) * histogram.count
        assert histogram.covered(value) >= wanted
        assert histogram.covered(math.nextafter(value, -1)) < wanted


def test_nothing_is_none() -> None:
    summary = DistanceHistogram(0.05, {}).summary()
    assert (summary.count, summary.mean_m, summary.variance_m2, summary.max_m) == (0, None, None, None)
    assert set(summary.quantiles_m.values()) == {None}
    assert DistanceHistogram(0.05, {}).bins(0.1) == []


def test_figure_5() -> None:
    assert DistanceHistogram(1.0, {10: 1}).summary().mean_m == pytest.approx(3.1623, abs=5e-5)


def test_plain_form_and_refusals() -> None:
    histogram = DistanceHistogram(0.1, {4: 2, 1: 7})
    assert DistanceHistogram.from_dict(histogram.to_dict()) == histogram
    with pytest.raises(InvalidValueError, match="cannot add"):
        _ = histogram + DistanceHistogram(0.05, {})
    with pytest.raises(InvalidValueError, match="0 or more"):
        DistanceHistogram(0.1, {-1: 2})
    with pytest.raises(InvalidValueError, match="share"):
        histogram.quantile_m(1.5)
