"""The renderer as a whole: the same again, light in closed form, clouds that coincide, errors."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from swardmap.errors import InvalidValueError, MissingExtraError
from swardmap.geometry import Intrinsics
from swardmap.labels import GRASS, PERSON
from swardmap.synth.light import sample_light
from swardmap.synth.model import Garden, Material, Model, Thing
from swardmap.synth.render import GardenRenderer
from swardmap.synth.shapes import box, mesh_of, placed
from tests.synth.render import plots


class Slider:
    """A box that moves along y, at each time with a mesh of its own."""

    def at(self, stamp_ns: int) -> Thing:
        T = placed(3.0, -1.0 + stamp_ns * 1e-9)
        return Thing(Model("slider", (box((0.4, 0.4, 1.2)),)), "person", T, PERSON, "walking")


def test_the_same_garden_gives_the_same_picture(grassy: GardenRenderer) -> None:
    garden = plots.garden_of(plots.ground_of(plots.bumpy, blade_m=0.04))
    light, pose = sample_light("sunset", np.random.default_rng(1)), plots.camera_at(yaw_deg=15)
    first = grassy.render(garden, light, plots.LENS, pose, 0)
    grassy.render(plots.garden_of(seed=8), plots.light_of(), plots.LENS, plots.camera_at(), 0)
    again = grassy.render(replace(garden), light, plots.LENS, pose, 0)
    assert np.array_equal(first.radiance, again.radiance)
    assert np.array_equal(first.depth_m, again.depth_m)
    assert np.array_equal(first.labels, again.labels)


def test_a_white_plate_has_the_radiance_of_lambert(bare: GardenRenderer) -> None:
    plate = mesh_of([(-2, -2, 1), (2, -2, 1), (2, 2, 1), (-2, 2, 1)], [(0, 0, 1)] * 4, np.zeros((4, 2)),
                    [(0, 1, 2), (0, 2, 3)], Material((0.8, 0.4, 0.2)))  # fmt: skip
    thing = Thing(Model("plate", (plate,)), "plate", placed(4.0, 0.0), tint=(1.0, 0.5, 1.0))
    light = plots.light_of(sun=2.0, sky=0.5)
    pose = plots.camera_at(height=3.0, pitch_deg=30)
    seen = bare.render(plots.garden_of(things=[thing]), light, plots.LENS, pose, 0)
    middle = seen.radiance[55:65, 75:85].reshape(-1, 3)
    assert (seen.thing[55:65, 75:85] == 1).all()
    assert middle == pytest.approx(np.tile([0.8, 0.2, 0.2], (100, 1)) * (2.0 * 0.8 + 0.5), rel=0.01)


def test_shadows_fall_where_rays_to_the_sun_are_blocked(bare: GardenRenderer) -> None:
    direction = np.array([0.48, 0.6, 0.64])
    wall = Thing(Model("wall", (box((0.1, 2.0, 0.8)),)), "wall", placed(4.0, 0.0))
    light = plots.light_of(2.0, 0.0, tuple(direction))
    pose = plots.camera_at(height=1.3)
    seen = bare.render(plots.garden_of(things=[wall]), light, plots.LENS, pose, 0)
    origin, rays = plots.rays(pose)
    p = (origin + rays * seen.depth_m[..., None])[(seen.thing == 0) & (seen.depth_m > 0) & (seen.depth_m < 6)]
    bright = seen.radiance.sum(-1)[(seen.thing == 0) & (seen.depth_m > 0) & (seen.depth_m < 6)] > 1e-3

    def blocked(points: np.ndarray, grow: float) -> np.ndarray:
        low, high = (3.95 - grow, -1.0 - grow, -1.0), (4.05 + grow, 1.0 + grow, 0.8 + grow)
        t = np.stack([(np.asarray(edge) - points) / direction for edge in (low, high)])
        near, far = t.min(0).max(-1), t.max(0).min(-1)
        return np.asarray((near < far) & (far > 0))

    surely, never = blocked(p, -0.045), ~blocked(p, 0.06)
    assert surely.sum() > 200
    assert not bright[surely].any()
    assert bright[never].all()


def test_what_moves_is_drawn_at_its_time(bare: GardenRenderer) -> None:
    garden = replace(plots.garden_of(), actors=(Slider(),))
    columns = []
    for second in (0.0, 1.0, 2.0):
        seen = bare.render(garden, plots.light_of(), plots.LENS, plots.camera_at(), round(second * 1e9))
        assert (seen.labels[seen.thing == 1] == PERSON.id).all()
        columns.append(float(np.nonzero(seen.thing == 1)[1].mean()))
    shift = plots.LENS.fx / 3.0
    assert -np.diff(columns) == pytest.approx([shift, shift], rel=0.1)


def test_more_samples_give_nearly_the_same_mean() -> None:
    garden = plots.garden_of(plots.ground_of(plots.bumpy, blade_m=0.05))
    means = []
    for samples in (1, 4, 16):
        try:
            renderer = GardenRenderer(plots.LENS.width, plots.LENS.height, samples)
        except MissingExtraError as error:
            pytest.skip(str(error))
        seen = renderer.render(garden, plots.light_of(), plots.LENS, plots.camera_at(), 0)
        means.append(seen.radiance.mean(axis=(0, 1)))
        renderer.close()
    assert means[0] == pytest.approx(means[2], rel=0.03)
    assert means[1] == pytest.approx(means[2], rel=0.03)


def test_truth_depends_on_neither_samples_nor_light(grassy: GardenRenderer) -> None:
    try:
        single = GardenRenderer(plots.LENS.width, plots.LENS.height, 1)
    except MissingExtraError as error:
        pytest.skip(str(error))
    wall = Thing(Model("wall", (box((0.1, 2.0, 0.8)),)), "wall", placed(3.0, 0.0))
    garden = plots.garden_of(plots.ground_of(plots.bumpy, blade_m=0.05), [wall])
    night = sample_light("twilight", np.random.default_rng(2))
    a = single.render(garden, plots.light_of(), plots.LENS, plots.camera_at(), 0)
    b = grassy.render(garden, night, plots.LENS, plots.camera_at(), 0)
    single.close()
    assert np.array_equal(a.depth_m, b.depth_m)
    assert np.array_equal(a.labels, b.labels)
    assert np.array_equal(a.thing, b.thing)


def test_colours_alone_are_those_of_the_view(grassy: GardenRenderer) -> None:
    garden = plots.garden_of(plots.ground_of(plots.bumpy, blade_m=0.05))
    arguments = (garden, plots.light_of(), plots.LENS, plots.camera_at(), 0)
    whole, alone = grassy.render(*arguments).radiance, grassy.radiance(*arguments)
    assert alone.shape == whole.shape
    assert alone.mean(axis=(0, 1)) == pytest.approx(whole.mean(axis=(0, 1)), rel=0.03)
    blocks = [image.reshape(12, 10, 16, 10, 3).mean(axis=(1, 3)) for image in (alone, whole)]
    assert np.corrcoef(blocks[0].ravel(), blocks[1].ravel())[0, 1] > 0.98


@pytest.mark.parametrize(
    ("samples", "views"),
    [
        (1, range(0, 100, 17)),
        (4, range(3, 100, 17)),
        pytest.param(1, range(0, 100, 2), marks=pytest.mark.slow),
        pytest.param(4, range(1, 100, 2), marks=pytest.mark.slow),
    ],
    ids=["1-some", "4-some", "1-many", "4-many"],
)
def test_no_sliver_breaks_out(samples: int, views: range, bare: GardenRenderer) -> None:
    """Blades are thinner than pixels: their light and depth stay within what light and ground allow."""
    try:
        renderer = GardenRenderer(plots.LENS.width, plots.LENS.height, samples)
    except MissingExtraError as error:
        pytest.skip(str(error))
    garden, light = plots.garden_of(plots.ground_of(plots.bumpy, blade_m=0.08)), plots.light_of(2.0, 0.4)
    for k in views:
        pose = plots.camera_at(0.1 * (k % 9), 0.05 * k, 37.0 * k, 0.3 + 0.1 * (k % 11), 8.0 + k % 20)
        seen = renderer.render(garden, light, plots.LENS, pose, 0)
        assert np.isfinite(seen.radiance).all()
        assert seen.radiance.max() < 2.0  # the sky is 0.4; no blade has an albedo above 0.7
        assert renderer.radiance(garden, light, plots.LENS, pose, 0).max() < 2.0
        ground = bare.render(garden, light, plots.LENS, pose, 0).depth_m
        origin, rays = plots.rays(pose)
        grass = (seen.depth_m > 0) & (seen.depth_m < 12)
        p = (origin + rays * seen.depth_m[..., None])[grass]
        above = p[:, 2] - garden.ground.height_at(p[:, :2])
        assert above.min() > -0.03
        assert above.max() < 0.2  # the longest blades
        # the coarser ground far off may be low by millimetres: centimetres of depth at a grazing angle
        assert (seen.depth_m <= ground + 0.1)[grass & (ground > 0)].all()
    renderer.close()


def test_clouds_of_several_frames_coincide(bare: GardenRenderer) -> None:
    """Points of the ground lie on the ground; a face that is seen from two places is the same face."""
    boxes = [
        Thing(Model("box", (box((0.5 + 0.1 * k, 0.7, 0.5)),)), "box",
              placed(2.5 + k, -1.5 + (1.7 * k) % 3, 0.1, 0.9 * k)) for k in range(5)
    ]  # fmt: skip
    garden = plots.garden_of(plots.ground_of(plots.bumpy), boxes)
    places = [(0.0, 0.0, 0.0), (0.4, 0.9, -12.0), (0.8, -1.0, 14.0), (1.1, 0.2, 3.0), (0.2, 1.6, -20.0)]
    poses = [plots.camera_at(*place, height=1.1, pitch_deg=14) for place in places]
    views = [(bare.render(garden, plots.light_of(), plots.LENS, T, 0), T) for T in poses]
    checked = 0
    for seen, T in views:
        origin, rays = plots.rays(T)
        points = origin + rays * seen.depth_m[..., None]
        ground = (seen.thing == 0) & (seen.depth_m > 0) & (seen.depth_m < 8) & plots.smooth(seen.depth_m)
        off = points[ground][:, 2] - garden.ground.height_at(points[ground][:, :2])
        assert np.quantile(np.abs(off), 0.99) < 0.002
        still = (seen.thing > 0) & plots.smooth(seen.depth_m, 5e-4)
        for other, T_other in views:
            at = T_other.inverse().apply(points[still])
            there, here = surface_at(other.depth_m, other.thing, seen.thing[still], at)
            checked += len(there)
            assert np.quantile(np.abs(there - here), 0.99) < 0.002
    assert checked > 10_000


def surface_at(
    depth: np.ndarray, thing: np.ndarray, wanted: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Depth of points in another picture, and that of the picture there, between four pixels of one thing.

    The inverse of depth is linear over a plane; only pixels around which it is are used.
    """
    p, wanted = p[p[:, 2] > 0.3], wanted[p[:, 2] > 0.3]
    u, v = (
        plots.LENS.fx * p[:, 0] / p[:, 2] + plots.LENS.cx,
        plots.LENS.fy * p[:, 1] / p[:, 2] + plots.LENS.cy,
    )
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    inside = (i >= 0) & (j >= 0) & (i < plots.LENS.width - 1) & (j < plots.LENS.height - 1)
    i, j, u, v, p, wanted = i[inside], j[inside], u[inside], v[inside], p[inside], wanted[inside]
    kept = np.ones(len(i), bool)
    plane = plots.smooth(depth, 5e-4)
    corners = []
    for dj, di in ((0, 0), (0, 1), (1, 0), (1, 1)):
        kept &= (thing[j + dj, i + di] == wanted) & plane[j + dj, i + di]
        corners.append(1 / np.maximum(depth[j + dj, i + di], 1e-6))
    a, b = u - i, v - j
    inverse = (corners[0] * (1 - a) + corners[1] * a) * (1 - b) + (corners[2] * (1 - a) + corners[3] * a) * b
    z = 1 / inverse
    kept &= np.abs(z - p[:, 2]) < 0.1  # nearer: hidden by another part of the same thing
    return z[kept], p[kept, 2]


def test_people_stand_on_the_lawn(bare: GardenRenderer) -> None:
    person = Thing(Model("p", (box((0.3, 0.4, 1.7)),)), "person", placed(3.0, 0.0), PERSON)
    seen = bare.render(plots.garden_of(things=[person]), plots.light_of(), plots.LENS, plots.camera_at(), 0)
    assert np.array_equal(seen.labels == PERSON.id, seen.thing == 1)
    bottom = np.nonzero((seen.labels == PERSON.id).any(axis=1))[0].max()
    assert (seen.labels[bottom + 1] == GRASS.id).all()


def test_another_size_is_refused(bare: GardenRenderer) -> None:
    lens = Intrinsics(64, 48, 60, 60, 32, 24)
    with pytest.raises(InvalidValueError, match="160 x 120"):
        bare.render(plots.garden_of(), plots.light_of(), lens, plots.camera_at(), 0)


def test_sizes_of_nothing_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="0 x 120"):
        GardenRenderer(0, 120)


def test_a_missing_driver_names_the_packages() -> None:
    pytest.importorskip("moderngl")
    code = (
        "from swardmap.errors import MissingExtraError\n"
        "from swardmap.synth.render import GardenRenderer\n"
        "try:\n    GardenRenderer(32, 32)\n"
        "except MissingExtraError as error:\n    print(error)\n"
    )
    # libglvnd finds no driver in an empty folder
    env = {**os.environ, "__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, check=True)
    assert "apt-get install libegl1 libgl1-mesa-dri" in done.stdout


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_memory_stays_flat_over_frames_and_gardens(grassy: GardenRenderer) -> None:
    gardens = [
        replace(plots.garden_of(plots.ground_of(plots.bumpy, blade_m=0.05), seed=k), actors=(Slider(),))
        for k in range(6)
    ]

    def used_mib() -> float:
        with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123 - not a file of ours
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20

    def run(garden: Garden, frames: int) -> None:
        for k in range(frames):
            pose = plots.camera_at(x=0.05 * k, yaw_deg=3.0 * k)
            grassy.render(garden, plots.light_of(), plots.LENS, pose, k * 100_000_000)

    for garden in gardens:
        run(garden, 30)
    before = used_mib()
    for garden in [*gardens, *gardens]:
        run(garden, 30)
    assert used_mib() - before < 30
