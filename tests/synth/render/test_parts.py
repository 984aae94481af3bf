"""Parts of the renderer that need no driver."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swardmap.errors import InvalidValueError
from swardmap.geometry import project
from swardmap.io.sources.eden_layout import LIGHTS
from swardmap.synth.light import sample_light
from swardmap.synth.render.blades import FULL_PER_M2, tufts
from swardmap.synth.render.camera import RenderCamera
from swardmap.synth.render.context import source_of
from swardmap.synth.render.ground import TILE, plain, tile_grid
from swardmap.synth.render.lawn import share_at
from swardmap.synth.render.shadow import light_from_map, to_texture
from swardmap.synth.render.targets import scale_of
from swardmap.synth.render.textures import HOLE, mipmaps
from swardmap.synth.scene.lawn_look import STRAW
from tests.synth.render import plots

angle = st.floats(0, 360)


@settings(max_examples=50, deadline=None)
@given(angle, st.floats(-20, 40), st.lists(st.floats(-8, 8), min_size=3, max_size=3))
def test_clip_coordinates_are_those_of_the_pinhole(yaw: float, pitch: float, p: list[float]) -> None:
    camera = RenderCamera.of(plots.LENS, plots.camera_at(1.0, -2.0, yaw, 0.9, pitch))
    at = (np.array(p) - camera.position_m) @ camera.axes
    if at[2] < 0.1:
        return
    clip = camera.clip_from_rel @ [*(np.array(p) - camera.position_m), 1]
    assert clip[3] == pytest.approx(at[2], rel=1e-9)
    uv, _ = project(at[None], plots.LENS)
    w, h = plots.LENS.width, plots.LENS.height
    fragment = (clip[:2] / clip[3] + 1) / 2 * [w, h]  # centres of fragments are at .5
    assert fragment - 0.5 == pytest.approx(uv[0], abs=1e-6)


@settings(max_examples=100, deadline=None)
@given(angle, st.lists(st.floats(-10, 10), min_size=3, max_size=3), st.floats(0.05, 3))
def test_no_sphere_is_culled_that_reaches_into_the_picture(
    yaw: float, centre: list[float], radius: float
) -> None:
    camera = RenderCamera.of(plots.LENS, plots.camera_at(0.0, 0.0, yaw))
    rng = np.random.default_rng(0)
    on = rng.standard_normal((400, 3))
    on = np.array(centre) + radius * on / np.linalg.norm(on, axis=1, keepdims=True)
    at = (on - camera.position_m) @ camera.axes
    front = at[at[:, 2] > 0.05]
    uv = front[:, :2] / front[:, 2:] * [plots.LENS.fx, plots.LENS.fy] + [plots.LENS.cx, plots.LENS.cy]
    inside = ((uv > -0.5) & (uv < [plots.LENS.width - 0.5, plots.LENS.height - 0.5])).all(axis=1)
    if inside.any():
        assert camera.sees(np.array([centre]), np.array([radius])).all()


def test_tufts_stand_on_the_lawn_and_depend_on_place_and_seed_alone() -> None:
    ground = plots.ground_of(plots.bumpy, lambda x, y: x - 0.3, 0.05)
    found = tufts(ground, 4, (0, 1))
    xy = found["root"][:, :2] + [0, 1]
    assert 0.5 * FULL_PER_M2 < len(found) < 0.8 * FULL_PER_M2
    assert ground.is_lawn(xy).all()
    assert found["root"][:, 2] == pytest.approx(ground.height_at(xy), abs=1e-5)
    assert np.array_equal(found, tufts(ground, 4, (0, 1)))
    assert not np.array_equal(found[:50], tufts(ground, 5, (0, 1))[:50])
    assert not len(tufts(ground, 4, (-3, 1)))
    assert not len(tufts(plots.ground_of(), 4, (0, 0)))  # without blades


def test_the_first_tufts_of_a_tile_are_spread_over_all_of_it() -> None:
    found = tufts(plots.ground_of(blade_m=0.05), 4, (1, 1))["root"][:200, :2]
    counts = np.histogram2d(found[:, 0], found[:, 1], 2, [(0, 1), (0, 1)])[0]
    assert counts.min() > 25


def test_blades_have_the_mean_colour_of_the_ground() -> None:
    look = tufts(plots.ground_of(blade_m=0.05), 4, (0, 0))["look"] / 255.0
    share = look[:, 3:]
    mean = (look[:, :3] ** 2 * (1 - share) + np.array(STRAW) * share).mean(axis=0)
    assert mean == pytest.approx([0.1, 0.14, 0.05], rel=0.03)


def test_blades_thin_out_and_end() -> None:
    share = share_at(np.linspace(0, 30, 300))
    assert share[0] == 1
    assert (np.diff(share) <= 0).all()
    assert share[-1] == 0


def areas(corners: np.ndarray) -> np.ndarray:
    """Of triangles, n x 3 x 2."""
    a, b = np.moveaxis(np.diff(corners.astype(float), axis=1), 1, 0)
    return np.asarray(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2)


@pytest.mark.parametrize("step", [1, 2, 4, 8])
def test_tiles_are_cut_along_the_diagonal_of_the_ground(step: int) -> None:
    vertices, faces = tile_grid(step)
    top = faces[(vertices[faces][..., 2] == 0).all(axis=1)]
    corners = vertices[top][..., :2]
    assert areas(corners).sum() == TILE**2
    # every triangle has an edge from (x + step, y) to (x, y + step)
    edges = corners - np.roll(corners, 1, axis=1)
    assert ((np.abs(edges) == step).all(axis=2) & (edges.prod(axis=2) < 0)).sum() == len(top)


def test_the_plain_surrounds_the_raster_without_gap_or_overlap() -> None:
    vertices, faces = plain(60, 41, 100)
    corners = vertices[faces][..., :2].astype(float)
    assert areas(corners).sum() == (59 + 200) * (40 + 200) - 59 * 40


def test_mipmaps_keep_the_share_that_is_solid_and_the_colour() -> None:
    rng = np.random.default_rng(0)
    solid = rng.random((64, 64)) < 0.3
    rgba = np.full((64, 64, 4), (200, 20, 20, 0), np.uint8)
    rgba[solid] = (20, 200, 20, 255)
    levels = mipmaps(rgba, cutout=True)
    assert [level.shape[0] for level in levels] == [64, 32, 16, 8, 4]
    assert np.array_equal(levels[0], rgba[::-1])
    for level in levels[1:4]:
        assert (level[..., 3] / 255 >= HOLE).mean() == pytest.approx(solid.mean(), abs=0.12)
        assert np.abs(level[level[..., 3] > 100][:, :3] - np.array([20.0, 200, 20])).max() < 12


def test_plain_mipmaps_average_in_linear_light() -> None:
    rgba = np.zeros((8, 8, 4), np.uint8)
    rgba[::2, ..., :3], rgba[..., 3] = 255, 255
    assert mipmaps(rgba, cutout=False)[1][..., :3] == pytest.approx(186, abs=1)  # half the light


@pytest.mark.parametrize(("samples", "scale"), [(1, 1), (2, 1), (4, 2), (9, 3), (16, 4)])
def test_samples_lie_in_a_square(samples: int, scale: int) -> None:
    assert scale_of(samples) == scale


def test_shadow_maps_look_along_the_sun() -> None:
    toward = np.array([0.48, 0.6, 0.64])
    map_of = to_texture(light_from_map(toward, np.array([1.0, 2.0, 0.0]), 5.0))
    p = np.array([2.0, 1.0, 0.3])
    here, nearer = map_of @ [*p, 1], map_of @ [*(p + 2 * toward), 1]
    assert nearer[:2] == pytest.approx(here[:2])
    assert nearer[2] < here[2]
    assert ((here[:3] > 0) & (here[:3] < 1)).all()


def test_shaders_include_each_part_once() -> None:
    text = source_of("ground.frag.glsl")
    assert text.count("uniform Frame") == 1
    assert "#include" not in text


@pytest.mark.parametrize("name", LIGHTS)
def test_lights_are_within_what_days_have(name: str) -> None:
    for seed in range(40):
        light = sample_light(name, np.random.default_rng(seed))
        colors = np.array([light.sun, light.zenith, light.horizon, light.bounce])
        assert light.illumination == name
        assert np.linalg.norm(light.sun_direction) == pytest.approx(1)
        assert light.sun_direction[2] > 0
        assert (colors >= 0).all()
        assert 0 <= light.clouds <= 1
        assert light.haze_per_m < 0.02  # at 10 m, less than a fifth is lost
        sky = (colors[1] + colors[2]) / 2
        assert sky[1] > 0.85 * (sky[0] + sky[2]) / 2  # nothing purple
        assert light == sample_light(name, np.random.default_rng(seed))


def test_days_are_brighter_than_evenings() -> None:
    def level(name: str) -> float:
        lights = [sample_light(name, np.random.default_rng(k)) for k in range(50)]
        return float(
            np.mean([np.mean(light.sun) * light.sun_direction[2] + np.mean(light.zenith) for light in lights])
        )

    levels = [level(name) for name in ("clear", "cloudy", "overcast", "sunset", "twilight")]
    assert levels[0] > levels[1] > levels[2] > levels[4]
    assert levels[1] > levels[3] > levels[4]


def test_other_lights_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="clear, cloudy"):
        sample_light("foggy", np.random.default_rng(0))
