"""Clothes cut from the baked tights and skirt, and whole outfits by chance."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from swardmap.synth.model import Float64Array, Material
from swardmap.synth.people.body import ARM, LEG, NECK, TRUNK, Body, Shell
from swardmap.synth.people.cloth import COLORS, DENIM, GREENS, HI_VIS, RGB, TROUSERS, fabric, linear, picked
from swardmap.synth.people.shell import clipped, finer, hemmed, lined, normals_of, smoothed, welded
from swardmap.synth.people.worn import Worn, plain_worn, worn_cloth

Level = Callable[[Shell], Float64Array]


@dataclass(frozen=True, slots=True)
class Cut:
    """How far clothes reach, in the coordinates of `Shell.along`.

    Attributes:
        sleeve: along the arm: 0.45 short, 1.9 long.
        hem: up the trunk: where the top ends below.
        collar: up the neck.
        legs: along the leg: 0.45 shorts, 1.9 trousers; 0 = a skirt instead.
        skirt: length of the skirt as a level of the leg.
        slack_m: between body and cloth.
        shoes: level of the leg where they end; 9 = barefoot.
    """

    sleeve: float
    hem: float
    collar: float
    legs: float
    skirt: float
    slack_m: float
    shoes: float


def cut_of(rng: np.random.Generator, body: Body) -> Cut:
    """What kind of clothes, by chance."""
    skirted = body.is_female and rng.random() < 0.3
    legs = 0.0 if skirted else float(rng.choice([0.55, 0.7, 0.85, 1.55, 1.9, 1.9, 1.9, 1.9]))
    sleeve = float(rng.choice([0.4, 0.5, 0.5, 0.62, 1.3, 1.86, 1.86, 1.86]))
    return Cut(
        sleeve=sleeve + float(rng.uniform(-0.04, 0.04)),
        hem=float(rng.uniform(-0.14, 0.0)),
        collar=float(rng.choice([0.0, 0.05, 0.3])) if sleeve > 1 else float(rng.choice([-0.12, -0.05, 0.02])),
        legs=legs + (float(rng.uniform(-0.04, 0.04)) if legs else 0.0),
        skirt=float(rng.choice([0.75, 0.95, 1.4])),
        slack_m=float(rng.uniform(0.006, 0.02)),
        shoes=9.0 if rng.random() < 0.1 else float(rng.choice([1.94, 1.94, 1.8])),
    )


def folds(rng: np.random.Generator, shell: Shell, depth_m: float) -> Float64Array:
    """n: height of low folds, by place on the mean body, the same on all bodies."""
    out = np.zeros(len(shell.xyz))
    for _ in range(7):
        wave = rng.normal(0, 1, 3)
        wave *= rng.uniform(40, 90) / np.linalg.norm(wave)
        phase = shell.mean @ wave + 2.5 * np.sin(shell.mean @ rng.normal(0, 12, 3)) + rng.uniform(0, 6.3)
        out += np.sin(phase) / 7
    near = np.exp(-(((shell.along[:, LEG] - 1.0) / 0.25) ** 2)) + np.exp(
        -(((shell.along[:, ARM] - 1.0) / 0.25) ** 2)
    )
    waist = np.exp(-(((shell.along[:, TRUNK] - 0.25) / 0.2) ** 2)) * (shell.along[:, ARM] < 0)
    return depth_m * out * (1.2 + 1.3 * near + 0.8 * waist)


def garment(
    rng: np.random.Generator,
    shell: Shell,
    slack: Level,
    material: Material,
    what: str,
    fold_m: float = 0.006,
    hem_m: float = 0.012,
) -> Worn:
    """Cloth over a cut shell: smoothed, lifted by `slack`, folded, with hems."""
    fine = finer(shell)
    xyz = smoothed(fine.xyz, fine, 3)
    n = normals_of(xyz, fine.faces, welded(fine))
    lift = slack(fine) + folds(rng, fine, fold_m)
    loose = replace(
        fine, xyz=xyz + n * np.maximum(lift, 0.003)[:, None], weights=smoothed(fine.weights, fine, 2)
    )
    return worn_cloth(hemmed(loose, hem_m), material, what)


def top(
    rng: np.random.Generator,
    body: Body,
    cut: Cut,
    material: Material,
    extra_m: float = 0.0,
    what: str = "top",
) -> Worn:
    """Shirt, pullover or jacket."""
    shell = clipped(body.tights, lambda s: s.along[:, TRUNK] - cut.hem)
    shell = clipped(shell, lambda s: cut.sleeve - s.along[:, ARM])
    shell = clipped(
        shell,
        lambda s: cut.collar - s.along[:, NECK] - 0.25 * np.clip(s.mean[:, 0] - body.head_mean[0], -0.1, 0.1),
    )

    def slack(s: Shell) -> Float64Array:
        arm = np.clip(s.along[:, ARM], 0, 2)
        low = np.clip((0.55 - s.along[:, TRUNK]) / 0.6, 0, 1) * (1 if cut.legs else -0.4)
        return cut.slack_m * (0.7 + 0.35 * arm) + 0.012 * low * (s.along[:, ARM] < 0) + extra_m

    return garment(rng, shell, slack, material, what, hem_m=0.02 if cut.sleeve < 1.5 else 0.012)


def trousers(rng: np.random.Generator, body: Body, cut: Cut, material: Material) -> Worn:
    """Trousers or shorts."""
    shell = clipped(body.tights, lambda s: 0.22 - s.along[:, TRUNK] - (s.along[:, ARM] > -0.9) * 9.0)
    shell = clipped(shell, lambda s: cut.legs - s.along[:, LEG])
    flare = float(rng.uniform(0.008, 0.028)) + (0.01 if cut.legs < 1 else 0.0)

    def slack(s: Shell) -> Float64Array:
        return 0.004 + 0.006 * (s.along[:, LEG] > 0.1) + flare * np.clip(s.along[:, LEG] - 0.15, 0, 1.2)

    return garment(rng, shell, slack, material, "trousers", 0.005, 0.03 if cut.legs < 1.6 else 0.015)


def skirt(rng: np.random.Generator, body: Body, cut: Cut, material: Material) -> Worn:
    """A skirt that hangs from the waist, with an inside."""
    at = dict(zip(body.bones, body.joints, strict=True))
    hip, knee, ankle = (float(at[f"{name}.L"][2]) for name in ("thigh", "calf", "foot"))
    low = hip + (knee - hip) * cut.skirt if cut.skirt < 1 else knee + (ankle - knee) * (cut.skirt - 1)
    shell = finer(clipped(body.skirt, lambda s: s.xyz[:, 2] - low))
    n = normals_of(shell.xyz, shell.faces, welded(shell))
    down = np.clip((hip + 0.1 - shell.xyz[:, 2]) / (hip - ankle), 0, 1)
    around = np.arctan2(shell.xyz[:, 1], shell.xyz[:, 0])
    pleats = np.sin(around * int(rng.integers(7, 15)) + rng.uniform(0, 6.3)) * 0.02 * down
    shell = replace(
        shell,
        xyz=shell.xyz + n * (0.02 + 0.5 * cut.slack_m + pleats)[:, None],
        weights=smoothed(shell.weights, shell, 8),
    )
    return worn_cloth(lined(shell, 0.004), material, "skirt")


def shoes(rng: np.random.Generator, body: Body, cut: Cut) -> list[Worn]:
    """Closed shoes with a sole; a level of 1.6 makes boots."""
    shell = finer(clipped(body.tights, lambda s: s.along[:, LEG] - cut.shoes))
    n = normals_of(shell.xyz, shell.faces, welded(shell))
    xyz = smoothed(shell.xyz, shell, 3) + n * np.where(shell.along[:, LEG] > 2.0, 0.006, 0.004)[:, None]
    floor = float(xyz[:, 2].min()) - 0.012
    xyz[:, 2] = np.where(xyz[:, 2] < floor + 0.028, floor, xyz[:, 2])
    shell = hemmed(replace(shell, xyz=xyz), 0.006)
    color = picked(
        rng,
        (
            (36, 34, 34),
            (70, 52, 40),
            (110, 84, 60),
            (220, 218, 212),
            (60, 70, 92),
            (150, 60, 50),
            (70, 84, 60),
        ),
    )
    sole = (30, 30, 30) if rng.random() < 0.5 else (206, 200, 190)
    upper = clipped(shell, lambda s: s.xyz[:, 2] - floor - 0.018)
    under = clipped(shell, lambda s: floor + 0.018 - s.xyz[:, 2])
    return [
        plain_worn(upper, Material(linear(color), specular=0.1, roughness=0.6), "shoes"),
        plain_worn(under, Material(linear(sole), roughness=0.9), "soles"),
    ]


def skin_left(body: Body, cut: Cut) -> Shell:
    """The skin that clothes leave free, and a little under their hems."""

    def level(s: Shell) -> Float64Array:
        bare = np.maximum(s.along[:, ARM] - cut.sleeve + 0.12, s.along[:, NECK] - cut.collar + 0.4)
        leg_from = cut.legs - 0.12 if cut.legs else 0.2
        leg = np.where(
            s.along[:, LEG] > -0.9,
            np.minimum(s.along[:, LEG] - leg_from, cut.shoes + 0.08 - s.along[:, LEG]),
            -1,
        )
        return np.maximum(bare, leg)

    return clipped(body.skin, level)


def material_of(rng: np.random.Generator, what: str, green: float = 0.15) -> Material:
    """A fabric for a part of an outfit; `green` is the share of green clothes, which look like lawn."""
    name = f"{what}-{int(rng.integers(2**62)):x}"
    if what == "trousers":
        if rng.random() < 0.4:
            return fabric(rng, "denim", picked(rng, DENIM), name)
        kind = "camouflage" if rng.random() < 0.08 else "plain"
        colors: tuple[RGB, ...] = GREENS if kind == "camouflage" or rng.random() < green else TROUSERS
        return fabric(rng, kind, picked(rng, colors), name)
    if what == "vest":
        return fabric(rng, "vest", picked(rng, HI_VIS), name)
    kind = str(
        rng.choice(
            ["plain", "plain", "plain", "stripes", "check", "print", "fleece", "camouflage"],
            p=(0.25, 0.15, 0.1, 0.14, 0.12, 0.12, 0.08, 0.04),
        )
    )
    chosen = GREENS if kind == "camouflage" or rng.random() < green else COLORS
    return fabric(rng, kind, picked(rng, chosen), name)


def clothes(rng: np.random.Generator, body: Body, cut: Cut) -> list[Worn]:
    """All that is worn below the neck."""
    upper = material_of(rng, "top")
    dress = not cut.legs and rng.random() < 0.5
    out = [top(rng, body, cut, upper, 0.006 if cut.sleeve > 1.7 and cut.collar > 0.2 else 0.0)]
    if cut.legs:
        out.append(trousers(rng, body, cut, material_of(rng, "trousers")))
    else:
        out.append(skirt(rng, body, cut, upper if dress else material_of(rng, "skirt")))
    if not body.is_child and rng.random() < 0.1:
        over = replace(cut, sleeve=0.12, hem=0.0, collar=-0.1)
        out.append(top(rng, body, over, material_of(rng, "vest"), 0.012, "vest"))
    if cut.shoes < 9:
        out += shoes(rng, body, cut)
    return out
