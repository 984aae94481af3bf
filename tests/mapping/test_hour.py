"""Some minutes of mowing: memory flat, cells in their places, the saved map equal to the live one.

The hour itself is benchmarks/bench_hour.py, whose drive this is.
"""

import tracemalloc
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from benchmarks.bench_hour import (
    CONFIG,
    EAST_M,
    LANE_M,
    LANES,
    LENGTH_M,
    NORTH_M,
    Truth,
    drive,
    lawn,
    marked_share,
    mow,
    way,
)
from swardmap.config import config_from_dict
from swardmap.pipeline import ObstacleMapper


def test_the_mower_stays_on_the_lawn() -> None:
    places = np.array([(x, y) for x, y, _ in islice(way(), 200_000)])
    assert places.min(axis=0).tolist() == pytest.approx([0.0, 0.0], abs=1e-6)
    assert places[:, 0].max() <= LENGTH_M
    assert places[:, 1].max() == LANE_M * (LANES - 1)
    assert np.abs(np.diff(places, axis=0)).max() <= LANE_M
    frame = next(drive(lawn()))
    assert frame.T_map_camera is not None
    assert frame.T_map_camera.position_m[:2] == pytest.approx((EAST_M, NORTH_M), abs=0.2)


@pytest.mark.slow
def test_minutes_of_mowing(tmp_path: Path) -> None:
    hour = mow(1.0, 0.25, tmp_path)
    assert hour.known > 20_000
    assert hour.differ <= hour.known // 10_000  # a point on a rim may fall to either cell, by float32
    share = marked_share(hour.shifts)
    assert share[2, 2] > 0.95
    assert (np.delete(share.ravel(), 12) < share[2, 2] - 0.2).all()  # moved by one cell it fits far worse
    assert hour.beside <= 5  # what the window forgot cannot be held against it
    assert hour.saved_equal
    assert hour.goes_on_equal
    assert max(sample.window_mb for sample in hour.samples) < 0.8


@pytest.mark.slow
def test_memory_is_flat_on_a_lawn_that_is_known() -> None:
    mapper = ObstacleMapper(Truth(), CONFIG)
    lap = list(islice(drive(lawn()), 300))
    held = []
    tracemalloc.start()
    try:
        for round_ in range(6):
            for i, frame in enumerate(lap):
                mapper.step(replace(frame, stamp_ns=1000 * round_ + i))
            held.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert held[-1] - held[1] < 50_000  # a frame is 40 kB, a tile 82 kB; 1200 came between


@pytest.mark.slow
def test_a_window_keeps_memory_flat_on_the_way() -> None:
    config = config_from_dict({"grid": {"mode": "evidence"}, "evidence": {"window_m": 12.0}})
    mapper = ObstacleMapper(Truth(), config)
    sizes = []
    for frame in islice(drive(lawn()), 800):
        mapper.step(frame)
        assert mapper.log_odds is not None
        sizes.append(len(mapper.log_odds.tiles))
    assert max(sizes) <= 9  # 12 m are not more than 3 tiles of 6.4 m
