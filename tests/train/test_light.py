"""Harsh light changes what a camera would see and nothing else; by default there is none of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swardmap.train.augment import mild_light, relight
from swardmap.train.data import draw_batch, load_photos
from swardmap.train.light import exposure_gain, harsh_light, saturated, shade, vignette, white_balance
from swardmap.train.recipe import AugmentConfig, recipe_from_dict, recipe_to_dict

MakeRecipe = Callable[..., dict[str, Any]]
GREY = np.full((60, 80, 3), 128, np.uint8)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32), level=st.integers(0, 255))
def test_every_image_stays_one(seed: int, level: int) -> None:
    lit = harsh_light(np.full((40, 56, 3), level, np.uint8), AugmentConfig(), np.random.default_rng(seed))
    assert lit.shape == (40, 56, 3)
    assert lit.dtype == np.uint8


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32), mean=st.floats(1e-4, 1.0), deviation=st.floats(0, 5))
def test_no_exposure_leaves_nothing_to_see(seed: int, mean: float, deviation: float) -> None:
    light = np.full((4, 4, 3), mean, np.float32)
    gain = exposure_gain(light, AugmentConfig(exposure=deviation), np.random.default_rng(seed))
    assert min(mean, 0.006) * 0.999 <= gain * mean <= max(mean, 0.6) * 1.001


def test_darker_is_more_frequent_than_brighter() -> None:
    light = np.full((4, 4, 3), 0.2, np.float32)
    gains = [exposure_gain(light, AugmentConfig(), np.random.default_rng(i)) for i in range(300)]
    assert 0.55 < np.mean(np.array(gains) < 1) < 0.85
    assert exposure_gain(light, AugmentConfig(exposure=0.0), np.random.default_rng(0)) == 1


def test_the_light_turns_blue_as_often_as_yellow_and_rarely_green() -> None:
    gains = np.stack([white_balance(AugmentConfig(cast=0.3), np.random.default_rng(i)) for i in range(400)])
    warm = np.log(gains[:, 0] / gains[:, 2]) / 2
    assert abs(warm.mean()) < 0.06
    assert 0.25 < warm.std() < 0.35
    assert np.log(gains[:, 1]).std() < 0.2
    np.testing.assert_array_equal(white_balance(AugmentConfig(cast=0.0), np.random.default_rng(0)), 1)


def test_shade_is_darker_and_bluer_than_the_sun_and_leaves_some_light() -> None:
    shades = [shade((60, 80), np.random.default_rng(i)) for i in range(60)]
    assert all(s.min() > 0.02 and s.max() <= 1 for s in shades)
    dark = [s[s[..., 1] < 0.9 * s[..., 1].max()] for s in shades if np.ptp(s) > 0.3]
    assert len(dark) > 20  # most have sun and shade in one image
    assert all((d[:, 2] >= d[:, 0]).all() for d in dark)


def test_a_vignette_costs_the_corners_what_it_says_and_the_centre_nothing() -> None:
    factors = vignette((61, 81), 0.7)
    assert factors[30, 40] == 1
    np.testing.assert_allclose(factors[[0, 0, -1, -1], [0, -1, 0, -1]], 0.3, rtol=1e-6)


def test_saturation_zero_is_opencv_grey_and_one_is_the_image() -> None:
    image = np.random.default_rng(0).integers(0, 256, (20, 30, 3), np.uint8)
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    np.testing.assert_array_equal(saturated(image, 0.0), np.repeat(grey[..., None], 3, 2))
    np.testing.assert_array_equal(saturated(image, 1.0), image)


def test_without_any_change_the_image_stays_but_for_noise_and_contrast() -> None:
    still = AugmentConfig(
        exposure=0, gamma=0, cast=0, saturation_low=1, saturation_high=1, vignette=0, shade=0
    )
    means = [harsh_light(GREY, still, np.random.default_rng(i)).mean() for i in range(20)]
    np.testing.assert_allclose(means, 128, atol=3)  # contrast turns about the middle grey


def test_by_default_the_light_is_mild_as_in_the_first_network() -> None:
    image = np.random.default_rng(5).integers(0, 256, (20, 30, 3), np.uint8)
    lit = relight(image, AugmentConfig(rare=0.0), np.random.default_rng(3))
    np.testing.assert_array_equal(lit, mild_light(image, 0.25, np.random.default_rng(3)))


def test_a_recipe_holds_the_light_and_its_views_follow_it(data_root: Path, tiny_recipe: MakeRecipe) -> None:
    tree = tiny_recipe()
    before = recipe_from_dict(tree)
    assert recipe_from_dict({**tree, "augment": {"harsh": 0.0}}).digest == before.digest
    recipe = recipe_from_dict({**tree, "augment": {"harsh": 1.0, "rare": 0.0}})
    assert recipe.digest != before.digest
    assert recipe_from_dict(recipe_to_dict(recipe)) == recipe
    sets = load_photos(recipe, data_root, validation=False)
    mild, harsh = (draw_batch(sets, r, range(60), step=0) for r in (before, recipe))
    for a, b in zip(mild, harsh, strict=True):  # the light draws last: the view is the same
        np.testing.assert_array_equal(a.codes, b.codes)
    brightness = [np.array([v.image.mean() for v in views]) for views in (mild, harsh)]
    assert (brightness[1] < 45).mean() > (brightness[0] < 45).mean() + 0.1


@pytest.mark.parametrize(("key", "value"), [("harsh", 1.5), ("cast", -0.1), ("vignette", 2), ("hars", 0.5)])
def test_settings_out_of_range_are_refused(key: str, value: float, tiny_recipe: MakeRecipe) -> None:
    with pytest.raises(Exception, match=key):
        recipe_from_dict({**tiny_recipe(), "augment": {key: value}})
