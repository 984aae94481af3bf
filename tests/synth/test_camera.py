"""The camera: what each fault must do to a picture, and what no fault may do."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.synth.config import OpticsConfig
from swardmap.synth.sensor.camera import (
    CameraFaults,
    draw_faults,
    exposure_gain,
    photograph,
    srgb,
    tone_curve,
)

CLEAN = CameraFaults()


def flat(value: float = 0.3, shape: tuple[int, int] = (120, 160)) -> NDArray[np.float32]:
    return np.full((*shape, 3), value, np.float32)


def lawn(seed: int = 0) -> NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    return (rng.uniform(0.3, 1.0, (120, 160, 1)) * [0.12, 0.25, 0.06]).astype(np.float32)


def taken(radiance: NDArray[np.float32], faults: CameraFaults = CLEAN, seed: int = 0) -> NDArray[np.float64]:
    return photograph(radiance, faults, np.random.default_rng(seed)).astype(np.float64)


def test_a_clean_camera_adds_nothing() -> None:
    picture = taken(flat())
    assert np.ptp(picture) == 0
    assert 105 < picture.mean() < 140, "grey is exposed to the middle"
    np.testing.assert_array_equal(taken(lawn(), seed=1), taken(lawn(), seed=2))


def test_srgb_has_the_values_of_the_standard() -> None:
    linear = np.array([0, 0.0031308, 0.18, 0.5, 1.0, 3.0], np.float32)
    np.testing.assert_allclose(srgb(linear), [0, 0.04045, 0.46136, 0.73536, 1, 1], atol=2e-5)


@settings(max_examples=50, deadline=None)
@given(st.floats(0.05, 0.95), st.floats(-0.3, 0.6))
def test_tone_curves_rise_and_stay_in_range(knee: float, contrast: float) -> None:
    y = tone_curve(np.linspace(0, 10, 2000, dtype=np.float32), knee, contrast)
    assert (np.diff(y) >= -1e-6).all()
    assert y[0] == 0
    assert y.max() <= 1


def test_the_exposure_follows_the_light_but_not_all_the_way() -> None:
    noon, dusk = taken(flat(0.35)).mean(), taken(flat(0.35 / 40)).mean()
    assert dusk < noon < 1.5 * dusk
    sky = flat(0.2)
    sky[:4] = 50.0  # glare at the border, 3 % of the picture
    assert exposure_gain(sky) > 0.9 * exposure_gain(flat(0.2))
    assert np.isfinite(taken(flat(0.0))).all()


def test_one_stop_is_twice_the_light() -> None:
    dark, plain = taken(flat(), replace(CLEAN, exposure_ev=-1.0)).mean(), taken(flat()).mean()

    def linear(value: float) -> float:
        return float((value / 255) ** 2.2)

    assert linear(plain) / linear(dark) == pytest.approx(2.0, rel=0.12)


def test_noise_grows_with_the_signal_and_in_the_dark() -> None:
    half = flat()
    half[:, 80:] *= 4
    noisy = replace(CLEAN, shot_noise=0.02, read_noise=0.001, contrast=0.0, knee=0.95)
    linear = (taken(half, noisy) / 255) ** 2.2
    assert linear[:, 90:, 1].std() / linear[:, :70, 1].std() == pytest.approx(2.0, rel=0.2)
    day, dusk = (taken(flat(v), noisy).std() for v in (0.3, 0.004))
    assert dusk > 3 * day


def test_vignetting_takes_light_from_the_corners_only() -> None:
    picture = taken(flat(), replace(CLEAN, vignetting=0.4))
    assert picture[0, 0, 1] < picture[60, 80, 1] - 15
    np.testing.assert_allclose(picture, picture[::-1, ::-1], atol=1)


def test_dirt_and_drops_stay_where_they_are() -> None:
    speck = replace(CLEAN, dirt=((0.25, 0.5, 0.05, 0.3),))
    darker = taken(flat()) - taken(flat(), speck)
    v, u = np.nonzero(darker[..., 1] > 5)
    assert u.mean() == pytest.approx(40, abs=1.5)
    assert v.mean() == pytest.approx(60, abs=1.5)
    two = flat(0.2)
    two[:60] = 0.5  # sky above, ground below: a drop shows them upside down
    wet = taken(two, replace(CLEAN, drops=((0.5, 0.75, 0.06),)))
    assert wet[95, 80, 1] > taken(two)[95, 80, 1] + 20
    np.testing.assert_array_equal(wet[:, :60], taken(two)[:, :60])


def test_aberration_parts_red_from_blue_at_the_rim_not_in_the_middle() -> None:
    lines = flat(0.1)
    lines[:, 4::8] = 0.5
    picture = taken(lines, replace(CLEAN, aberration=0.006))
    apart = np.abs(picture[..., 0] - picture[..., 2])
    assert apart[:, :8].max() > 30
    assert apart[:, 72:88].max() < apart[:, :8].max() / 2


def test_colours_keep_their_order_under_a_wrong_white_balance() -> None:
    warm = taken(flat(), replace(CLEAN, gains=(1.05, 1.0, 0.95)))
    r, g, b = warm.mean(axis=(0, 1))
    assert r > g > b
    assert r - b < 25


def test_drawn_cameras_leave_a_lawn_green_and_not_neon() -> None:
    for seed in range(40):
        faults = draw_faults(OpticsConfig(), np.random.default_rng(seed))
        r, g, b = taken(lawn(), faults, seed).mean(axis=(0, 1))
        assert g > r > b, faults
        assert 45 < g < 215, faults
        assert b > 8, faults


def test_faults_off_gives_the_clean_camera() -> None:
    assert draw_faults(OpticsConfig(faults=False), np.random.default_rng(5)) == CLEAN


def test_cameras_are_drawn_by_seed_and_within_their_ranges() -> None:
    config = OpticsConfig(exposure_ev=(-0.5, 0.25), jpeg_quality=(60, 61))
    drawn = [draw_faults(config, np.random.default_rng(s)) for s in range(60)]
    assert drawn[7] == draw_faults(config, np.random.default_rng(7))
    assert all(-0.5 <= f.exposure_ev <= 0.25 and f.jpeg_quality in (60, 61) for f in drawn)
    assert {len(f.dirt) for f in drawn} >= {0, 1, 2, 3}


def test_jpeg_loses_a_little() -> None:
    plain, compressed = taken(lawn()), taken(lawn(), replace(CLEAN, jpeg_quality=70))
    assert 0 < np.abs(plain - compressed).mean() < 25


@pytest.mark.parametrize("bad", [np.ones((4, 5), np.float32), np.full((4, 5, 3), np.nan, np.float32)])
def test_what_is_no_radiance_is_refused(bad: NDArray[np.float32]) -> None:
    with pytest.raises(InvalidValueError, match="camera: expected finite radiance"):
        photograph(bad, CLEAN, np.random.default_rng(0))
