"""Face, hair and hats."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from swardmap.synth.model import Float64Array, Material, Mesh, Texture
from swardmap.synth.people.body import NECK, Body, Shell
from swardmap.synth.people.cloth import RGB, fabric, linear, picked
from swardmap.synth.people.shell import clipped, finer, hemmed, normals_of, smoothed, welded
from swardmap.synth.people.worn import Worn, plain_worn, rigid, split_worn
from swardmap.synth.shapes import joined, mesh_of, sphere

SKIN: tuple[RGB, ...] = (
    (238, 204, 180), (230, 188, 158), (222, 178, 146), (208, 160, 126), (182, 132, 98), (146, 98, 68),
    (104, 68, 48), (76, 52, 40),
)  # fmt: skip
HAIR: tuple[RGB, ...] = (
    (28, 24, 22), (46, 34, 28), (72, 50, 36), (104, 74, 48), (146, 112, 70), (188, 154, 100), (128, 62, 36),
)  # fmt: skip
GREY: tuple[RGB, ...] = ((150, 148, 144), (196, 194, 190), (224, 222, 218), (112, 110, 108))
WIDTH, HEIGHT = 384, 256
LOW_M, HIGH_M = -0.26, 0.16  # heights of the face's picture, from the eyes


def azimuth(mean: Float64Array, body: Body) -> Float64Array:
    """Angle about the upright axis of the head, 0 in front, left positive."""
    out: Float64Array = np.arctan2(mean[..., 1], mean[..., 0] - _axis_x(body))
    return out


def _axis_x(body: Body) -> float:
    return float(body.eyes_mean[:, 0].mean() - 0.085)


def face(rng: np.random.Generator, body: Body, tone: RGB, hair: RGB, bearded: bool) -> Texture:
    """What a face shows from some way off: eyes, brows, lips, cheeks, perhaps a beard."""
    a = ((np.arange(WIDTH) + 0.5) / WIDTH - 0.5) * 2 * np.pi
    z = HIGH_M - (np.arange(HEIGHT) + 0.5) / HEIGHT * (HIGH_M - LOW_M)
    across, up = np.meshgrid(a, z)
    image = np.broadcast_to(np.array(tone), (HEIGHT, WIDTH, 3)).astype(np.float64)
    eye_a = float(abs(azimuth(body.eyes_mean, body)).mean())
    mouth_z = float(body.mouth_mean[2] - body.eyes_mean[:, 2].mean())
    r = 0.085

    def blend(mask: Float64Array, color: RGB | Float64Array, share: float) -> None:
        nonlocal image
        m = np.clip(mask, 0, 1)[..., None] * share
        image = image * (1 - m) + np.array(color) * m

    skin = np.array(tone)
    side = (np.abs(across) - eye_a) * r
    blend(1.3 - np.hypot(side - 0.008, (up + 0.045)) / 0.028, skin * [1.0, 0.82, 0.8], 0.45)  # cheeks
    blend(1.2 - np.hypot(across * r / 0.016, (up + 0.042) / 0.014), skin * [1.0, 0.86, 0.84], 0.4)  # nose
    blend(1.5 - np.hypot(side / 0.024, up / 0.016), skin * 0.72, 0.5)  # shadow of the sockets
    if bearded:
        low = np.clip((-0.048 - up) / 0.012, 0, 1) * np.clip((1.3 - np.abs(across)) / 0.2, 0, 1)
        low = low * np.clip((up + 0.15) / 0.02, 0, 1)
        blend(low * rng.uniform(0.75, 1.0, low.shape), hair, float(rng.choice([0.35, 0.75, 0.9])))
    lips = skin * [0.86, 0.6, 0.58] if not body.is_female else np.array([166.0, 70, 72]) * 0.6 + skin * 0.3
    blend(3 - 2.4 * np.hypot(across * r / 0.025, (up - mouth_z) / 0.009), lips, 0.85)
    blend((np.abs(across * r) < 0.022) * (1.4 - np.abs(up - mouth_z) / 0.0017), skin * 0.3, 0.8)
    blend(4 - 3 * np.hypot(side / 0.0155, up / 0.0062), (222, 216, 210), 0.95)
    iris = np.array([(70, 48, 34), (52, 38, 30), (88, 104, 120), (96, 100, 70)][int(rng.integers(4))])
    blend((np.hypot(side / 0.0155, up / 0.0062) < 1) * (3 - 2 * np.hypot(side, up) / 0.0062), iris, 1.0)
    blend(
        (np.hypot(side / 0.0155, up / 0.0062) < 1) * (3 - 2 * np.hypot(side, up) / 0.003), (14, 12, 12), 1.0
    )
    lash = up - 0.0062 * (1 - (side / 0.018) ** 2)
    blend((np.abs(side) < 0.017) * (1.5 - np.abs(lash) / 0.002), skin * 0.22, 0.9)
    arch = up - 0.0215 + 5.0 * side**2 - 0.06 * side
    blend((np.abs(side) < 0.021) * (1.5 - np.abs(arch) / 0.0036), np.array(hair) * 0.8, 0.85)
    image = image * (1 + 0.025 * rng.standard_normal((HEIGHT, WIDTH, 1)))
    rgba = np.full((HEIGHT, WIDTH, 4), 255, np.uint8)
    rgba[..., :3] = np.clip(image, 0, 255).astype(np.uint8)
    return Texture(f"face-{int(rng.integers(2**62)):x}", rgba)


def skin_of(body: Body, shell: Shell, tone: RGB, picture: Texture) -> list[Worn]:
    """Skin as a head with a face and the rest in one colour."""
    is_head = shell.along[shell.faces][:, :, NECK].min(1) > 0.15
    out = []
    for these, material, what in (
        (is_head, Material(texture=picture, specular=0.04, roughness=0.6), "face"),
        (~is_head, Material(linear(tone), specular=0.04, roughness=0.6), "skin"),
    ):
        if not these.any():
            continue
        part = replace(shell, faces=shell.faces[these])
        corner = part.mean[part.faces]
        u = azimuth(corner, body) / (2 * np.pi) + 0.5
        u = np.where(np.ptp(u, axis=1)[:, None] > 0.5, np.where(u < 0.5, u + 1, u), u)
        v = (corner[..., 2] - body.eyes_mean[:, 2].mean() - LOW_M) / (HIGH_M - LOW_M)
        worn = split_worn(part, np.stack((u, v), axis=-1), material, what)
        # faces of both parts meet: their normals come from the whole skin where they can
        out.append(worn)
    return out


def hairline(body: Body, high: float = 0.0, low: float = 0.0) -> Callable[[Shell], Float64Array]:
    """Level of `clipped`: positive where hair grows. `high` raises it in front, `low` behind, metres."""
    angle = np.radians([0, 30, 52, 68, 82, 96, 108, 130, 180])
    height = np.array([0.066, 0.06, 0.046, 0.02, -0.012, 0.0, -0.045, -0.07, -0.075])
    height += high * np.clip(1 - angle / 1.6, 0, 1) * 1.6 + low * np.clip(angle - 1.7, 0, 1)

    def level(shell: Shell) -> Float64Array:
        a = np.abs(azimuth(shell.mean, body))
        up = shell.mean[:, 2] - body.eyes_mean[:, 2].mean()
        out = up - np.interp(a, angle, height)
        ear = (np.abs(shell.mean[:, 1]) > 0.0765) & (up < 0.035)
        return np.where(ear | (shell.along[:, NECK] < 0.2), -0.05, np.clip(out, -0.05, 0.2))

    return level


def hair_material(rng: np.random.Generator, color: RGB) -> Material:
    """Strands: dark and light lines along v."""
    strand = rng.normal(0, 1, 256)
    strand = (strand + np.roll(strand, 1) + 0.6 * np.roll(strand, 3)) * 0.09
    rows = 1 + 0.05 * np.sin(np.arange(64) / 64 * 2 * np.pi + 2)[:, None] + strand[None, :]
    rgba = np.full((64, 256, 4), 255, np.uint8)
    rgba[..., :3] = np.clip(np.array(color) * rows[..., None], 0, 255).astype(np.uint8)
    return Material(texture=Texture(f"hair-{int(rng.integers(2**62)):x}", rgba), specular=0.12, roughness=0.5)


def cap_of_hair(
    rng: np.random.Generator, body: Body, material: Material, thick_m: float, high: float, low: float
) -> Worn:
    """Short hair: the scalp, lifted, thin at its edge."""
    level = hairline(body, high, low)
    scalp = finer(clipped(body.skin, level))
    lift = np.clip(level(scalp) / 0.03, 0.12, 1) * thick_m
    n = normals_of(scalp.xyz, scalp.faces, welded(scalp))
    bumps = np.zeros(len(scalp.xyz))
    for _ in range(6):
        bumps += np.sin(scalp.mean @ rng.normal(0, 70, 3) + rng.uniform(0, 6.3)) / 6
    lift = lift * (1 + 0.6 * bumps)
    shell = replace(scalp, xyz=smoothed(scalp.xyz + n * (lift + 0.002)[:, None], scalp, 2))
    shell = hemmed(shell, 0.006)
    corner = shell.mean[shell.faces]
    u = azimuth(corner, body) / (2 * np.pi)
    u = np.where(np.ptp(u, axis=1)[:, None] > 0.5, u % 1, u)
    return split_worn(shell, np.stack((u * 3, corner[..., 2] * 4), axis=-1), material, "hair")


def head_box(body: Body) -> tuple[Float64Array, Float64Array]:
    """Centre and half-axes of the ellipsoid around the skull, on the body at rest."""
    up = body.skin.mean[:, 2] - body.eyes_mean[:, 2].mean()
    skull = body.skin.xyz[(up > 0.015) & (np.abs(body.skin.mean[:, 1]) < 0.0765)]
    low, high = skull.min(0), skull.max(0)
    centre = np.array([(low[0] + high[0]) / 2, 0.0, low[2]])
    return centre, np.array([(high[0] - low[0]) / 2, (high[1] - low[1]) / 2, high[2] - low[2]])


def long_hair(body: Body, material: Material, length_m: float) -> Worn:
    """A curtain from ear to ear around the back, down to the shoulders or further."""
    centre, half = head_box(body)
    rows, columns = 12, 25
    a = np.radians(np.linspace(72, 288, columns))
    t = np.linspace(0, 1, rows)[:, None]
    scale = half[2] / 0.13
    out = 1.06 + 0.1 * np.sin(np.pi * np.minimum(t * 1.6, 1)) - 0.04 * t + 0.02 * np.sin(a * 9)
    drop = 0.5 * half[2] - t * length_m * scale
    x = centre[0] + np.cos(a) * half[0] * out * (1 - 0.12 * t)
    y = centre[1] + np.sin(a) * half[1] * out
    z = centre[2] + drop + 0.0 * a
    xyz = np.stack((x, y, z), axis=-1).reshape(-1, 3)
    weights = np.zeros((len(xyz), len(body.bones)))
    low = np.clip((np.repeat(t[:, 0], columns) * length_m - 0.12) / 0.25, 0, 0.85)
    weights[:, body.bones.index("head")], weights[:, body.bones.index("chest")] = 1 - low, low
    k = np.arange(rows * columns).reshape(rows, columns)
    p, q, r, s = k[:-1, :-1].ravel(), k[:-1, 1:].ravel(), k[1:, 1:].ravel(), k[1:, :-1].ravel()
    faces = np.concatenate([np.stack((p, s, q), 1), np.stack((q, s, r), 1)])
    shell = Shell(xyz, weights, np.full((len(xyz), 4), -1.0), xyz, faces)
    uv = np.stack((np.tile(a / 2.1, rows), np.repeat(-t[:, 0], columns)), axis=-1)
    return plain_worn(shell, replace(material, cutout=True), "hair", uv)


def tail(body: Body, material: Material, bun: bool) -> Worn:
    """A bun or a pony tail at the back of the head."""
    centre, half = head_box(body)
    ball = sphere(1.0, 8, 12, material)
    size = np.array([0.042, 0.046, 0.04]) if bun else np.array([0.035, 0.03, 0.13])
    at = centre + np.array([-half[0] - (0.018 if bun else 0.03), 0, 0.02 if bun else -0.2 * half[2] - 0.12])
    xyz = (ball.xyz - [0, 0, 1]) * size + (np.array([0, 0, size[2]]))
    lean = np.array([[1, 0, 0.18 if not bun else 0], [0, 1, 0], [0, 0, 1]])
    n = ball.normals / size
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return rigid(body, "head", mesh_of(xyz @ lean.T, n, ball.uv, ball.faces, material), at)


def hat(rng: np.random.Generator, body: Body, kind: str) -> Worn:
    """A cap, straw hat, beanie or bicycle helmet."""
    centre, half = head_box(body)
    name = f"hat-{int(rng.integers(2**62)):x}"
    if kind == "straw":
        material = fabric(rng, "check", (206, 176, 118), name)
    elif kind == "helmet":
        material = Material(
            linear(picked(rng, ((230, 230, 230), (40, 40, 44), (170, 40, 40), (50, 90, 150)))),
            specular=0.3,
            roughness=0.3,
        )
    else:
        material = fabric(
            rng,
            "plain",
            picked(rng, ((40, 46, 60), (150, 40, 44), (210, 206, 196), (60, 80, 60), (30, 30, 32))),
            name,
        )
    lift = {"straw": 1.12, "cap": 1.08, "beanie": 1.1, "helmet": 1.2}[kind]
    dome = _dome(half * lift + 0.006, material)
    parts = [dome]
    if kind == "straw":
        parts.append(_brim(half * lift + 0.006, 0.085 * half[0] / 0.1, 0.0, 2 * np.pi, material))
    elif kind == "cap":
        parts.append(_brim(half * lift + 0.006, 0.065 * half[0] / 0.1, -0.75, 0.75, material))
    at = centre + np.array([0.0, 0, 0.28 * half[2]])
    return rigid(body, "head", joined(parts), at)


def _dome(half: Float64Array, material: Material) -> Mesh:
    """The upper half of an ellipsoid, with an inside."""
    lat, lon = np.meshgrid(np.linspace(-0.1, np.pi / 2, 9), np.linspace(0, 2 * np.pi, 25), indexing="ij")
    unit = np.stack((np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)), -1).reshape(-1, 3)
    n = unit / half
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    uv = np.stack((lon / (2 * np.pi) * 2, lat), -1).reshape(-1, 2)
    k = np.arange(9 * 25).reshape(9, 25)
    p, q, r, s = k[:-1, :-1].ravel(), k[:-1, 1:].ravel(), k[1:, 1:].ravel(), k[1:, :-1].ravel()
    f = np.concatenate([np.stack((p, q, r), 1), np.stack((p, r, s), 1)])
    size = np.array([half[0], half[1], half[2] * 0.86])
    outer = mesh_of(unit * size, n, uv, f, material)
    return joined([outer, mesh_of(unit * size * 0.97, -n, uv, f[:, ::-1], material)])


def _brim(half: Float64Array, wide_m: float, start: float, end: float, material: Material) -> Mesh:
    """A flat ring or a peak around the lower edge of a dome, two-sided."""
    a = np.linspace(start, end, 25)
    full = end - start > 6
    taper = np.ones_like(a) if full else np.sqrt(np.clip(1 - (a / end) ** 4, 0, 1))
    inner = np.stack((np.cos(a) * half[0] * 0.97, np.sin(a) * half[1] * 0.97, np.zeros_like(a)), 1)
    droop = -0.012 if full else -0.02
    outer = np.stack(
        (
            np.cos(a) * (half[0] + wide_m * taper),
            np.sin(a) * (half[1] + wide_m * taper * (1 if full else 0.25)),
            np.full_like(a, droop),
        ),
        1,
    )
    xyz = np.concatenate([inner, outer])
    k, n = np.arange(24), 25
    f = np.concatenate([np.stack((k, k + n, k + n + 1), 1), np.stack((k, k + n + 1, k + 1), 1)])
    uv = np.concatenate([np.stack((a, np.zeros_like(a)), 1), np.stack((a, np.full_like(a, 0.3)), 1)])
    up = np.tile([0.0, 0, 1], (2 * n, 1))
    return joined(
        [mesh_of(xyz, up, uv, f, material), mesh_of(xyz - [0, 0, 0.003], -up, uv, f[:, ::-1], material)]
    )
