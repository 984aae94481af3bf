"""Latency from image stamp to costmap, and cores used, as they are told."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.ros.load import Load


@given(st.lists(st.integers(1, 500), min_size=1, max_size=200))
def test_percentiles_are_order_statistics(delays_ms: list[int]) -> None:
    load = Load()
    for i, delay in enumerate(delays_ms, 1):
        load.published(i * 1_000_000_000, i * 1_000_000_000 + delay * 1_000_000)
    facts, order = load.facts, sorted(delays_ms)
    for name, share in (("p50", 0.5), ("p99", 0.99)):
        rank = int(np.ceil(share * len(order))) - 1
        assert facts[f"costmap_latency_{name}_ms"] == pytest.approx(order[rank], abs=0.05)


def test_a_costmap_without_a_new_image_says_nothing_of_latency() -> None:
    load = Load()
    load.published(1_000_000_000, 1_050_000_000)
    load.published(1_000_000_000, 9_000_000_000)  # the same image, given out once more
    assert load.facts["costmap_latency_p99_ms"] == 50.0
    load.published(1_000, 2_000_000)  # a clock that began anew is taken from then on
    load.published(2_000, 3_000_000)
    assert load.facts["costmap_latency_p50_ms"] == pytest.approx(3.0, abs=0.1)


def test_cores_used_are_those_of_this_process() -> None:
    load = Load()
    assert load.facts["cores_used"] is None  # nothing to compare with yet
    end = time.monotonic() + 0.6
    while time.monotonic() < end:
        pass
    used = load.facts["cores_used"]
    assert isinstance(used, float)
    assert 0 < used < 1.5
