"""Contact sheets: models of people drawn side by side, to look at.

python tools/bake_people/sheet.py OUT.png [--poses standing,walking] [--seed 1] [--people 5]
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.synth.model import Mesh, Model

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
  vec3 light = vec3(1.9, 1.8, 1.6) * max(dot(m, normalize(vec3(.6, .45, .8))), 0) + vec3(.28, .33, .4) * (.6 + .4 * m.z)
             + vec3(.25) * max(dot(m, normalize(vec3(.3, -.9, .2))), 0);
  rgba = vec4(pow(min(albedo * light, vec3(1)), vec3(1 / 2.2)), 1);
}"""


class Baked:
    """The baked arrays without a bundle around them."""

    def __init__(self, path: Path) -> None:
        with np.load(path, allow_pickle=False) as file:
            self._arrays = {name: file[name] for name in file.files}

    def arrays(self, name: str) -> dict[str, NDArray[np.generic]]:
        """All of them, whatever the name."""
        return self._arrays


def look_at(eye: NDArray[np.float64], target: NDArray[np.float64], fov_deg: float, aspect: float) -> NDArray[np.float64]:  # fmt: skip
    """4 x 4 from the frame of the model to clip coordinates."""
    f = (target - eye) / np.linalg.norm(target - eye)
    r = np.cross(f, [0, 0, 1.0])
    r /= np.linalg.norm(r)
    u = np.cross(r, f)
    view = np.eye(4)
    view[:3, :3] = np.stack((r, u, -f))
    view[:3, 3] = -view[:3, :3] @ eye
    near, far, k = 0.05, 50.0, 1 / np.tan(np.radians(fov_deg) / 2)
    projection = np.array([[k / aspect, 0, 0, 0], [0, k, 0, 0], [0, 0, (far + near) / (near - far), 2 * far * near / (near - far)], [0, 0, -1, 0]])  # fmt: skip
    return projection @ view


def picture(ctx, program, model: Model, size: tuple[int, int], azimuth_deg: float, target, distance_m: float, height_m: float = 0.5):  # type: ignore[no-untyped-def]  # fmt: skip
    """H x W x 3 of uint8: one model on a grey floor."""
    import moderngl

    frame = ctx.framebuffer([ctx.renderbuffer(size, samples=4)], ctx.depth_renderbuffer(size, samples=4))
    plain = ctx.simple_framebuffer(size)
    frame.use()
    ctx.clear(0.62, 0.66, 0.7)
    ctx.enable(moderngl.DEPTH_TEST)
    a = np.radians(azimuth_deg)
    eye = np.asarray(target) + distance_m * np.array([np.cos(a), np.sin(a), 0]) + [0, 0, height_m]
    program["clip"].write(
        look_at(eye, np.asarray(target, float), 30, size[0] / size[1]).T.astype("f4").tobytes()
    )
    floor = Mesh(np.array([[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]], np.float32), np.tile(np.float32([0, 0, 1]), (4, 1)),
                 np.zeros((4, 2), np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.uint32), model.meshes[0].material.__class__((0.2, 0.3, 0.12)))  # fmt: skip
    for mesh in (floor, *model.meshes):
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
        data = np.hstack([mesh.xyz, mesh.normals, mesh.uv]).astype("f4")
        vao = ctx.vertex_array(program, [(ctx.buffer(data.tobytes()), "3f 3f 2f", "xyz", "normal", "uv")], ctx.buffer(mesh.faces.astype("u4").tobytes()))  # fmt: skip
        vao.render()
    ctx.copy_framebuffer(plain, frame)
    out = np.frombuffer(plain.read(), np.uint8).reshape(size[1], size[0], 3)[::-1].copy()
    frame.release()
    plain.release()
    return out


def sheet(models: list[Model], columns: int, size: tuple[int, int] = (200, 260), azimuth_deg: float = 25, target=None, distance_m: float | None = None):  # type: ignore[no-untyped-def]  # fmt: skip
    """All models in a grid."""
    import moderngl

    ctx = moderngl.create_standalone_context(backend="egl")
    program = ctx.program(VERTEX, FRAGMENT)
    tiles = []
    for model in models:
        low, high = model.bounds_m()
        middle = (low + high) / 2 if target is None else target
        far = distance_m or max(float(np.linalg.norm(high - low)) * 1.75, 1.2)
        tiles.append(picture(ctx, program, model, size, azimuth_deg, middle, far, 0.25 * far))
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    return np.vstack([np.hstack(tiles[k : k + columns]) for k in range(0, len(tiles), columns)])


def main() -> None:
    """Draw the sheet that the command line asks for."""
    import cv2

    from swardmap.synth.people import POSES, person

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--assets", type=Path, required=True)
    parser.add_argument("--poses", default=",".join(POSES))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--people", type=int, default=5)
    parser.add_argument("--azimuth", type=float, default=25)
    given = parser.parse_args()
    people = Baked(given.assets)
    models = [
        person(np.random.default_rng([given.seed, k, i]), people, pose).model
        for i, pose in enumerate(given.poses.split(","))
        for k in range(given.people)
    ]
    cv2.imwrite(str(given.out), sheet(models, given.people, azimuth_deg=given.azimuth)[..., ::-1])


if __name__ == "__main__":
    main()
