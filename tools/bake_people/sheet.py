"""Contact sheets: people drawn side by side, to look at.

python -m tools.bake_people.sheet OUT.png [--poses standing,walking] [--seed 1] [--people 5]
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from swardmap.synth.assets import Assets, open_assets
from swardmap.synth.model import Material, Mesh, Model
from swardmap.synth.people import POSES, person
from swardmap.synth.people.figure import figure_of
from swardmap.synth.people.gait import gait_of, step_meshes
from swardmap.synth.shapes import box

VERTEX = """#version 330
uniform mat4 clip; in vec3 xyz; in vec3 normal; in vec2 uv; out vec3 n; out vec2 t; out vec3 p;
void main() { n = normal; t = uv; p = xyz; gl_Position = clip * vec4(xyz, 1); }"""
FRAGMENT = """#version 330
uniform vec3 color; uniform sampler2D image; uniform int textured; uniform int cutout;
in vec3 n; in vec2 t; in vec3 p; out vec4 rgba;
void main() {
  vec4 texel = textured == 1 ? texture(image, t) : vec4(1);
  if (cutout == 1 && texel.a < 0.4) discard;
  vec3 m = normalize(n); if (cutout == 1 && !gl_FrontFacing) m = -m;
  vec3 albedo = color * pow(texel.rgb, vec3(2.2));
  vec3 light = vec3(1.9, 1.8, 1.6) * max(dot(m, normalize(vec3(.6, .45, .8))), 0)
             + vec3(.28, .33, .4) * (.6 + .4 * m.z)
             + vec3(.25) * max(dot(m, normalize(vec3(.3, -.9, .2))), 0);
  rgba = vec4(pow(min(albedo * light, vec3(1)), vec3(1 / 2.2)), 1);
}"""
FLOOR = box((6.0, 6.0, 0.1), Material((0.2, 0.3, 0.12)))
XYZ = NDArray[np.float64]


def look_at(eye: XYZ, target: XYZ, fov_deg: float, aspect: float) -> XYZ:
    """4 x 4 from the frame of the model to clip coordinates."""
    f = (target - eye) / np.linalg.norm(target - eye)
    r = np.cross(f, [0, 0, 1.0])
    r /= np.linalg.norm(r)
    view = np.eye(4)
    view[:3, :3] = np.stack((r, np.cross(r, f), -f))
    view[:3, 3] = -view[:3, :3] @ eye
    near, far, k = 0.05, 50.0, 1 / np.tan(np.radians(fov_deg) / 2)
    projection = np.diag([k / aspect, k, (far + near) / (near - far), 0.0])
    projection[2, 3], projection[3, 2] = 2 * far * near / (near - far), -1
    return projection @ view


def draw(ctx: Any, program: Any, mesh: Mesh) -> None:
    """One mesh into the framebuffer that is used."""
    material = mesh.material
    (ctx.disable if material.cutout else ctx.enable)(moderngl.CULL_FACE)
    program["color"].value = material.color
    program["textured"].value = int(material.texture is not None)
    program["cutout"].value = int(material.cutout)
    if material.texture is not None:
        rgba = np.ascontiguousarray(material.texture.rgba[::-1])
        image = ctx.texture((rgba.shape[1], rgba.shape[0]), 4, rgba.tobytes())
        image.build_mipmaps()
        image.use()
    data = ctx.buffer(np.hstack([mesh.xyz, mesh.normals, mesh.uv]).astype("f4").tobytes())
    faces = ctx.buffer(mesh.faces.astype("u4").tobytes())
    ctx.vertex_array(program, [(data, "3f 3f 2f", "xyz", "normal", "uv")], faces).render()


def picture(
    ctx: Any, program: Any, model: Model, size: tuple[int, int], azimuth_deg: float, focus: str
) -> NDArray[np.uint8]:
    """H x W x 3: one model on a green floor, the whole of it or its head."""
    frame = ctx.framebuffer([ctx.renderbuffer(size, samples=4)], ctx.depth_renderbuffer(size, samples=4))
    plain = ctx.simple_framebuffer(size)
    frame.use()
    ctx.clear(0.62, 0.66, 0.7)
    ctx.enable(moderngl.DEPTH_TEST)
    low, high = (corner.astype(np.float64) for corner in model.bounds_m())
    target, far = (low + high) / 2, max(float(np.linalg.norm(high - low)) * 1.75, 1.2)
    if focus == "head":
        target, far = np.array([*target[:2], high[2] - 0.14]), 1.0
    a = np.radians(azimuth_deg)
    eye = target + far * np.array([np.cos(a), np.sin(a), 0.25])
    program["clip"].write(look_at(eye, target, 30, size[0] / size[1]).T.astype("f4").tobytes())
    floor = Mesh(FLOOR.xyz - np.float32([0, 0, 0.1]), FLOOR.normals, FLOOR.uv, FLOOR.faces, FLOOR.material)
    for mesh in (floor, *model.meshes):
        draw(ctx, program, mesh)
    ctx.copy_framebuffer(plain, frame)
    out = np.frombuffer(plain.read(), np.uint8).reshape(size[1], size[0], 3)[::-1].copy()
    frame.release()
    plain.release()
    return out


def sheet(
    models: Sequence[Model], columns: int, size: tuple[int, int], azimuth_deg: float, focus: str = "all"
) -> NDArray[np.uint8]:
    """All models in a grid."""
    ctx = moderngl.create_standalone_context(backend="egl")
    program = ctx.program(VERTEX, FRAGMENT)
    tiles = [picture(ctx, program, model, size, azimuth_deg, focus) for model in models]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    return np.vstack([np.hstack(tiles[k : k + columns]) for k in range(0, len(tiles), columns)])


def somebody(assets: Assets, pose: str, seed: list[int], k: int, count: int) -> Model:
    """A person in a pose; of those who walk or run, in the k-th of `count` phases."""
    rng = np.random.default_rng(seed)
    if pose not in ("walking", "running"):
        return person(rng, assets, pose).model
    figure = figure_of(rng, assets)
    gait = gait_of(figure, 2.6 if pose == "running" else 1.2, pose == "running")
    return Model(pose, step_meshes(figure, gait, k / count))


def main() -> None:
    """Draw the sheet that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--assets", type=Path, help="default: as swardmap finds them")
    parser.add_argument("--poses", default=",".join((*POSES, "walking", "running")))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--people", type=int, default=5)
    parser.add_argument("--azimuth", type=float, default=25)
    parser.add_argument("--focus", choices=("all", "head"), default="all")
    given = parser.parse_args()
    assets = open_assets(given.assets)
    models = [
        somebody(assets, pose, [given.seed, k, i], k, given.people)
        for i, pose in enumerate(given.poses.split(","))
        for k in range(given.people)
    ]
    cv2.imwrite(
        str(given.out), sheet(models, given.people, (200, 260), given.azimuth, given.focus)[..., ::-1]
    )


if __name__ == "__main__":
    main()
