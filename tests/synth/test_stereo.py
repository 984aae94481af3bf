"""The depth sensor against the error formula of stereo, geometry done by hand, and its own switches."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.errors import ConfigError, InvalidValueError
from swardmap.synth.config import StereoConfig
from swardmap.synth.sensor.stereo import (
    StereoModel,
    draw_stereo,
    literature_sigma_m,
    occluded,
    stereo_depth,
)

F, B = 424.0, 0.05
IDEAL = StereoModel(subpixel_px=0, dropout=0, flying=0, speckle_px=0, step_px=1 / 256)


def textured(shape: tuple[int, int] = (240, 320), seed: int = 0) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(60, 200, shape, np.uint8)


def read(
    depth: NDArray[np.floating],
    model: StereoModel,
    gray: NDArray[np.uint8] | None = None,
    seed: int = 0,
    fx_px: float = F,
) -> NDArray[np.float64]:
    gray = textured(depth.shape) if gray is None else gray
    millimetres = stereo_depth(depth, gray, fx_px, model, np.random.default_rng(seed))
    return millimetres.astype(np.float64) / 1000


@pytest.mark.parametrize("subpixel_px", [0.05, 0.08])
@pytest.mark.parametrize("z", [1.0, 2.0, 4.0, 6.0])
def test_noise_on_a_wall_grows_with_the_square_of_the_distance(subpixel_px: float, z: float) -> None:
    model = StereoModel(subpixel_px=subpixel_px, dropout=0)
    seen = np.concatenate([read(np.full((240, 320), z), model, seed=s).ravel() for s in range(6)])
    seen = seen[seen > 0]
    step_m = z * z / (F * B) / 32
    expected = np.hypot(
        subpixel_px * z * z / (F * B), step_m / np.sqrt(12)
    )  # error formula; uniform rounding
    assert seen.std() == pytest.approx(expected, rel=0.08)
    assert abs(seen.mean() - z) < 0.12 * expected


def test_a_slanted_ground_has_no_bias() -> None:
    v = np.arange(240)[:, None]
    disparity = 2.0 + 0.04 * v * np.ones((1, 320))
    depth = F * B / disparity
    error = np.concatenate(
        [
            F * B / d[d > 0] - disparity[d > 0]
            for d in (read(depth, StereoModel(dropout=0), seed=s) for s in range(8))
        ]
    )
    assert abs(np.median(error)) < 0.01
    assert error.std() == pytest.approx(0.08, rel=0.1)


def test_readings_are_whole_steps_of_disparity() -> None:
    seen = read(np.full((60, 80), 5.0), StereoModel(speckle_px=0))
    steps = F * B / seen[seen > 0] * 32
    step_of_a_millimetre = F * B / 5.0**2 * 32 * 1e-3
    assert np.abs(steps - np.rint(steps)).max() < step_of_a_millimetre
    assert len(np.unique(seen)) > 5


def test_an_ideal_sensor_gives_back_a_wall_and_the_size_of_the_image_does_not_matter() -> None:
    for fx_px in (212.0, 424.0, 848.0):
        np.testing.assert_allclose(read(np.full((60, 80), 2.0), IDEAL, fx_px=fx_px), 2.0, atol=0.0015)


def test_the_shadow_lies_left_of_a_near_thing_and_is_as_wide_as_the_parallax() -> None:
    depth = np.full((90, 320), 4.0)
    depth[:, 200:260] = 1.0
    seen = read(depth, replace(IDEAL, fattening=0.5))
    parallax = F * B / 1.0 - F * B / 4.0  # 15.9 px
    row = seen[45]
    shadow = np.nonzero(row == 0)[0]
    assert len(shadow) == pytest.approx(parallax, abs=1.1)
    assert shadow.max() == 199
    assert shadow.min() == 200 - len(shadow)
    assert (row[262:] > 3.9).all(), "nothing is hidden on the right"


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.5, 2.0))
def test_hidden_is_what_a_nearer_point_covers(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    disparity = rng.choice([2.0, 5.0, 11.3, 20.0], (1, 40)).astype(np.float32)
    u = np.arange(40, dtype=np.float32)
    right = u - disparity[0] * np.float32(scale)
    expected = [any(right[j] <= right[i] for j in range(i + 1, 40)) for i in range(40)]
    assert occluded(disparity, scale)[0].tolist() == expected


def test_near_things_grow_by_a_part_of_the_window_and_thin_ones_vanish() -> None:
    depth = np.full((90, 320), 4.0)
    depth[:, 200:260] = 2.0
    depth[:, 100] = 2.0  # one pixel of a window of seven
    row = read(depth, replace(IDEAL, fattening=0.3))[45]
    fat = np.nonzero(np.abs(row - 2.0) < 0.1)[0]
    assert fat.max() in (260, 261)
    assert not np.isin(np.arange(95, 106), fat).any()


@pytest.mark.parametrize(
    ("gray", "least", "most"),
    [(5, 0.9, 1.0), (255, 0.9, 1.0), (128, 0.55, 0.85)],
    ids=["dark", "glare", "blank"],
)
def test_where_nothing_can_be_matched_are_holes(gray: int, least: float, most: float) -> None:
    picture = textured()
    picture[:, 160:] = gray
    seen = read(np.full((240, 320), 2.0), StereoModel(dropout=0.01, speckle_px=0), picture)
    lost = (seen == 0)[:, 170:].mean()
    assert least <= lost <= most
    assert (seen == 0)[:, :150].mean() < 0.03


def test_holes_are_as_many_as_asked_for() -> None:
    model = StereoModel(dropout=0.1, speckle_px=0)
    lost = np.mean([(read(np.full((240, 320), 2.0), model, seed=s) == 0).mean() for s in range(8)])
    assert lost == pytest.approx(0.1, abs=0.02)


def test_sky_and_what_is_out_of_range_has_no_reading() -> None:
    depth = np.full((60, 200), 2.0)
    depth[:, :50], depth[:, 50:100], depth[:, 100:150] = 0.0, 30.0, 0.15
    seen = read(depth, IDEAL)
    assert not seen[:, :45].any()
    assert not seen[:, 55:95].any()
    assert not seen[:, 105:145].any()
    assert (seen[:, 160:] > 0).all()


def test_flying_pixels_lie_between_front_and_back() -> None:
    depth = np.full((90, 320), 6.0)
    depth[:, 200:] = 2.0
    calm, wild = (read(depth, replace(IDEAL, flying=share)) for share in (0.0, 0.5))
    assert not ((calm > 2.1) & (calm < 5.5)).any()
    columns = np.nonzero(((wild > 2.1) & (wild < 5.5)).sum(axis=0))[0]
    assert len(columns) >= 3
    assert columns.min() > 190
    assert columns.max() < 210


def test_islands_are_removed() -> None:
    depth = np.full((90, 320), 0.0)
    depth[40:52, 100:112], depth[20:70, 200:300] = 2.0, 2.0
    kept, cleaned = (read(depth, replace(IDEAL, fattening=0.5, speckle_px=n)) for n in (0, 400))
    assert kept[46, 106] > 0
    assert cleaned[46, 106] == 0
    assert cleaned[45, 250] > 0


def test_a_calibration_error_scales_the_depth() -> None:
    seen = read(np.full((60, 80), 3.0), replace(IDEAL, scale_error=0.02))
    np.testing.assert_allclose(seen, 3.06, atol=0.003)


def test_the_same_seed_gives_the_same_depth() -> None:
    depth = np.full((60, 80), 3.0)
    np.testing.assert_array_equal(read(depth, StereoModel(), seed=3), read(depth, StereoModel(), seed=3))
    assert (read(depth, StereoModel(), seed=3) != read(depth, StereoModel(), seed=4)).any()
    assert draw_stereo(StereoConfig(), np.random.default_rng(1)) == draw_stereo(
        StereoConfig(), np.random.default_rng(1)
    )


def test_sensors_are_drawn_within_their_ranges() -> None:
    config = StereoConfig(subpixel_px=(0.06, 0.07), dropout=(0.0, 0.0))
    models = [draw_stereo(config, np.random.default_rng(s)) for s in range(50)]
    assert all(0.06 <= m.subpixel_px <= 0.07 and m.dropout == 0 for m in models)
    assert len({m.subpixel_px for m in models}) == 50
    with pytest.raises(ConfigError, match=r"expected \[low, high\]"):
        StereoConfig(subpixel_px=(0.2, 0.1))
    with pytest.raises(ConfigError, match="expected at least 0"):
        StereoConfig(dropout=(-0.1, 0.1))


def test_the_ranges_enclose_what_was_measured_on_a_real_d435() -> None:
    model, gray = StereoModel(), textured((480, 640))
    for z in (1.0, 2.0, 3.0):
        seen = (
            stereo_depth(np.full(gray.shape, z), gray, model.focal_px, model, np.random.default_rng(0)) * 1e-3
        )
        assert seen[seen > 0].std() == pytest.approx(model.sigma_m(z), rel=0.08)
        low, high = (StereoModel(subpixel_px=s).sigma_m(z) for s in StereoConfig().subpixel_px)
        assert 0.85 * low < literature_sigma_m(z) < high
    assert model.sigma_m(2.0) < 0.02 * 2.0  # the data sheet: at most 2 % at 2 m


def test_steps_too_small_to_count_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="enlarge step_px"):
        read(np.ones((4, 4)), replace(IDEAL, step_px=1 / 4096))


def test_images_of_different_size_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="one size"):
        stereo_depth(np.ones((4, 4)), np.ones((4, 5), np.uint8), F, IDEAL, np.random.default_rng(0))
