"""The ground: slopes of gardens, borders where the plan has them, colours of lawns as photos show them."""

import colorsys

import numpy as np
import pytest

from swardmap.synth.model import Float32Array, Garden
from swardmap.synth.scene.ground import signed_distance_m
from swardmap.synth.scene.lawn_look import HUE_DEG, SATURATION, VALUE, lawn_look
from swardmap.synth.scene.lot import plan_lot
from swardmap.synth.terrain import Surface
from tests.synth.scene.gardens import SEEDS, garden

each_garden = pytest.mark.parametrize("seed", SEEDS)


def inner(it: Garden, margin_m: float = 4.2) -> tuple[slice, slice]:
    """The lot's box on the rasters."""
    k = int(margin_m / it.ground.texel_m)
    return slice(k, -k), slice(k, -k)


def srgb(linear: Float32Array) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


@each_garden
def test_slopes_are_those_of_gardens(seed: int) -> None:
    """The lot slopes up to 8 degrees; banks up to 25; no step in the land, but for ponds."""
    it = garden(seed)
    ground = it.ground
    z = ground.height_m[inner(it)].astype(np.float64)
    y, x = np.mgrid[0 : z.shape[0], 0 : z.shape[1]] * ground.texel_m
    plane = np.column_stack((x.ravel(), y.ravel(), np.ones(z.size)))
    (gx, gy, _), *_ = np.linalg.lstsq(plane, z.ravel(), rcond=None)
    assert np.degrees(np.arctan(np.hypot(gx, gy))) < 8.5
    every = max(1, round(0.25 / ground.texel_m))
    steep = np.hypot(*np.gradient(z[::every, ::every], every * ground.texel_m))
    assert np.degrees(np.arctan(np.quantile(steep, 0.999))) < 30
    assert 0.003 < (z - (plane @ [gx, gy, 0]).reshape(z.shape)).std() < 0.6


@each_garden
def test_most_of_a_lot_is_lawn_and_the_rest_is_told(seed: int) -> None:
    it = garden(seed)
    lawn, surface = it.ground.lawn_m[inner(it)] > 0, it.ground.surface[inner(it)]
    assert 0.45 < lawn.mean() < 0.995
    assert (surface[~lawn] != Surface.LAWN).mean() > 0.99
    blades = it.ground.blade_height_m[inner(it)]
    assert not (blades[it.ground.lawn_m[inner(it)] < -2 * it.ground.texel_m] > 0).any()
    assert blades[lawn].min() > 0.005
    assert blades[lawn].max() < 0.15


@each_garden
def test_lawns_have_the_colours_of_turf(seed: int) -> None:
    """Linear reflectance 2 to 30 %, green most and blue least, saturation below that of paint."""
    it = garden(seed)
    lawn = (it.ground.lawn_m > 0.3) & (it.ground.dryness < 0.3)
    albedo = it.ground.albedo[lawn]
    r, g, b = albedo.mean(axis=0)
    assert b < r < 1.15 * g
    assert 0.04 < g < 0.25
    hue, saturation, value = colorsys.rgb_to_hsv(*(float(c) for c in srgb(np.array([r, g, b], np.float32))))
    assert 50 < 360 * hue < 100
    assert 0.2 < saturation < 0.72
    assert 0.2 < value < 0.55
    assert albedo.min() > 0.003
    assert np.quantile(albedo, 0.999) < 0.4


def test_looks_are_within_the_ranges_of_photos_and_fill_them() -> None:
    looks = [lawn_look(np.random.default_rng([seed, 2])) for seed in range(400)]
    for name, (low, high) in (("hue_deg", HUE_DEG), ("saturation", SATURATION), ("value", VALUE)):
        values = np.array([getattr(look, name) for look in looks])
        assert low <= values.min() < low + 0.2 * (high - low)
        assert high - 0.2 * (high - low) < values.max() <= high
    heights = [look.height_m for look in looks]
    assert 0.02 <= min(heights) < 0.03
    assert 0.1 < max(heights) <= 0.12
    for part in ("stripe", "moss", "clover", "bare", "worn"):
        share = np.mean([getattr(look, part) > 0 for look in looks])
        assert 0.15 < share < 0.6, part
    assert {look.dry for look in looks} == {0.02, 0.1, 0.3, 0.6}


def test_lots_measure_12_to_40_m_and_are_convex() -> None:
    for seed in range(300):
        corners = plan_lot(np.random.default_rng([seed, 1])).corners_m
        size = np.ptp(corners, axis=0)
        assert (size >= 12 - 1e-6).all()
        assert (size <= 40).all()
        along = np.roll(corners, -1, axis=0) - corners
        after = np.roll(along, -1, axis=0)
        assert (along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0] > 0).all()


def test_all_that_breaks_a_lawn_comes_up_and_paths_are_of_every_kind() -> None:
    lots = [plan_lot(np.random.default_rng([seed, 1])) for seed in range(300)]
    surfaces = {area.surface for lot in lots for area in lot.areas}
    assert surfaces == set(Surface) - {Surface.LAWN}
    strips = {area.surface for lot in lots for area in lot.areas if hasattr(area.shape, "points_m")}
    assert {Surface.GRAVEL, Surface.PAVING, Surface.DIRT, Surface.CONCRETE} <= strips
    assert {kind for lot in lots for kind in lot.edges} == {"fence", "hedge", "wall", "wire", "open"}
    assert 0.4 < np.mean([lot.house is not None for lot in lots]) < 0.9


def test_distance_to_a_circle_is_the_true_one() -> None:
    """Within two hundredths of a texel at the border, half a texel farther off."""
    texel, radius = 0.03, 2.0
    y, x = np.mgrid[-100:100, -100:100].astype(np.float32) * np.float32(texel)
    truth = np.float32(radius) - np.hypot(x, y)
    for field in (truth, truth * 0.6, np.float32(radius**2) - x * x - y * y):
        found = signed_distance_m(field.astype(np.float32), texel)
        near = np.abs(truth) < texel
        assert np.abs(found - truth)[near].max() < 0.05 * texel
        assert np.abs(found - truth).max() < 0.75 * texel
        assert ((found > 0) == (truth > 0)).all()


def test_a_field_without_a_border_is_all_one_or_the_other() -> None:
    assert (signed_distance_m(np.ones((4, 4), np.float32), 0.1) > 100).all()
    assert (signed_distance_m(-np.ones((4, 4), np.float32), 0.1) < -100).all()
