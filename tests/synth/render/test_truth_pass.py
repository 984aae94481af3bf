"""Depth, labels and things against rays in closed form."""

from collections.abc import Callable

import numpy as np
import pytest

from swardmap.labels import GRASS, OTHER, PERSON
from swardmap.synth.model import Float64Array, Garden, Mesh, Model, Thing, View
from swardmap.synth.render import GardenRenderer
from swardmap.synth.shapes import box, cylinder, placed, sphere
from tests.synth.render import plots

MOST_M = 0.001


def view(renderer: GardenRenderer, garden: Garden, **where: float) -> tuple[View, Float64Array, Float64Array]:
    pose = plots.camera_at(**where)
    return renderer.render(garden, plots.light_of(), plots.LENS, pose, 0), *plots.rays(pose)


@pytest.mark.parametrize(("yaw_deg", "height"), [(0.0, 0.8), (77.0, 0.35), (200.0, 1.3)])
def test_depth_of_bumpy_ground_is_that_of_its_triangles(
    bare: GardenRenderer, yaw_deg: float, height: float
) -> None:
    ground = plots.ground_of(plots.bumpy)
    seen, origin, directions = view(bare, plots.garden_of(ground), yaw_deg=yaw_deg, height=height)
    depth = plots.hit_ground(origin, directions, ground)
    near = (depth > 0) & (depth < 10) & plots.smooth(depth)
    assert near.sum() > 4000
    error = np.abs(seen.depth_m - depth)[near]
    assert np.quantile(error, 0.99) < MOST_M
    assert np.median(error) < 1e-4


def test_the_plain_beyond_the_raster_is_as_level_as_its_border(bare: GardenRenderer) -> None:
    ground = plots.ground_of(plots.bumpy)
    seen, origin, directions = view(bare, plots.garden_of(ground), x=9.0, height=1.3)
    depth = plots.hit_ground(origin, directions, ground, 30.0)
    p = origin + directions * seen.depth_m[..., None]
    beyond = (p[..., 0] > plots.HALF_M) & (depth > 0) & plots.smooth(depth)
    assert beyond.sum() > 300
    assert np.quantile(np.abs(seen.depth_m - depth)[beyond], 0.99) < MOST_M
    assert (seen.labels[beyond] == GRASS.id).all()


Hit = Callable[[Float64Array, Float64Array], Float64Array]
SOLIDS: dict[str, tuple[Mesh, Hit]] = {
    "box": (box((0.5, 0.8, 0.6)), lambda o, d: plots.hit_box(o, d, (2.25, -0.6, 0), (2.75, 0.2, 0.6))),
    "sphere": (sphere(0.4, 256, 512), lambda o, d: plots.hit_sphere(o, d, (2.5, -0.2, 0.4), 0.4)),
    "cylinder": (cylinder(0.3, 0.7, 1024), lambda o, d: plots.hit_cylinder(o, d, (2.5, -0.2), 0.3, 0.0, 0.7)),
}  # fmt: skip


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_have_the_depth_and_the_pixels_of_their_closed_form(bare: GardenRenderer, name: str) -> None:
    mesh, hit = SOLIDS[name]
    post = Thing(Model("post", (box((0.1, 0.1, 2.0)),)), "post", placed(6.0, 0.5))
    person = Thing(Model(name, (mesh,)), "person", placed(2.5, -0.2), PERSON)
    seen, origin, directions = view(bare, plots.garden_of(things=[post, person]))
    solid = hit(origin, directions)
    back = plots.hit_box(origin, directions, (5.95, 0.45, 0), (6.05, 0.55, 2.0))
    with np.errstate(divide="ignore"):
        floor = np.where(directions[..., 2] < 0, -origin[2] / directions[..., 2], np.inf)
    depth = np.minimum(np.minimum(solid, back), floor)
    thing = np.select([depth == solid, depth == back], [2, 1], 0)
    thing[~np.isfinite(depth)] = 0
    depth = np.where(np.isfinite(depth) & (depth < 60), depth, 0)
    inner = plots.smooth(depth)
    assert (thing[inner] == 2).sum() > 500
    assert (thing == 1).sum() > 50
    assert np.quantile(np.abs(seen.depth_m - depth)[inner & (depth < 20)], 0.99) < MOST_M
    assert np.array_equal(seen.thing[inner], thing[inner])
    expected = np.select([thing == 2, thing == 1], [PERSON.id, OTHER.id], GRASS.id)
    assert np.array_equal(seen.labels[inner], expected[inner])
    assert (seen.thing != thing).mean() < 0.002  # at edges, a pixel's centre may fall to either side


def test_a_model_is_turned_and_stretched_as_its_matrix_says(bare: GardenRenderer) -> None:
    T = placed(2.6, 0.1, 0.05, np.deg2rad(30), (0.6, 0.8, 0.5))
    seen, origin, directions = view(
        bare, plots.garden_of(things=[Thing(Model("box", (box((1, 1, 1)),)), "box", T)])
    )
    inverse = np.linalg.inv(T)
    o = inverse[:3, :3] @ origin + inverse[:3, 3]
    depth = plots.hit_box(o, directions @ inverse[:3, :3].T, (-0.5, -0.5, 0), (0.5, 0.5, 1))
    inner = (seen.thing == 1) & plots.smooth(np.where(np.isfinite(depth), depth, 0))
    assert inner.sum() > 500
    assert np.quantile(np.abs(seen.depth_m - depth)[inner], 0.99) < MOST_M


def test_grass_is_where_the_ground_says(bare: GardenRenderer) -> None:
    ground = plots.ground_of(plots.bumpy, lambda x, y: np.hypot(x - 3, y) - 1.2 + 0.2 * np.sin(3 * y))
    seen, origin, directions = view(bare, plots.garden_of(ground))
    depth = plots.hit_ground(origin, directions, ground)
    inner = (depth > 0) & (depth < 10) & plots.smooth(depth)
    p = (origin + directions * depth[..., None])[inner][:, :2]
    lawn = ground.is_lawn(p)
    clear = np.ones(len(p), bool)  # more than 2 mm from the border
    for step in ((0.002, 0), (-0.002, 0), (0, 0.002), (0, -0.002)):
        clear &= ground.is_lawn(p + step) == lawn
    assert 0.1 < lawn.mean() < 0.9
    assert np.array_equal(seen.labels[inner][clear] == GRASS.id, lawn[clear])


def test_sky_has_no_depth_no_thing_and_is_other(bare: GardenRenderer) -> None:
    seen, _, directions = view(bare, plots.garden_of(), pitch_deg=-10.0)
    up = directions[..., 2] > 0.01
    assert up.mean() > 0.5
    assert not seen.depth_m[up].any()
    assert not seen.thing[up].any()
    assert (seen.labels[up] == OTHER.id).all()
    assert np.isfinite(seen.radiance).all()


def test_blades_are_grass_and_nearer_than_the_ground(grassy: GardenRenderer, bare: GardenRenderer) -> None:
    ball = Thing(Model("ball", (sphere(0.15),)), "ball", placed(1.8, 0.1))
    garden = plots.garden_of(plots.ground_of(blade_m=0.06), [ball])
    with_blades, *_ = view(grassy, garden)
    without, *_ = view(bare, garden)
    ground = (without.thing == 0) & (without.depth_m > 0)
    covered = without.depth_m - with_blades.depth_m > 0.01
    assert covered[ground & (without.depth_m < 3)].mean() > 0.5
    assert (with_blades.depth_m <= without.depth_m + 1e-4)[ground].all()
    assert (with_blades.labels[ground] == GRASS.id).all()
    hidden = (without.thing == 1) & (with_blades.thing == 0)
    assert hidden.any()  # blades stand before the ball
    assert (with_blades.labels[hidden] == GRASS.id).all()


def test_no_blades_stand_where_there_is_no_lawn(grassy: GardenRenderer, bare: GardenRenderer) -> None:
    garden = plots.garden_of(plots.ground_of(lawn=lambda x, y: -1.0 + 0 * x * y, blade_m=0.06))
    assert np.array_equal(view(grassy, garden)[0].depth_m, view(bare, garden)[0].depth_m)
