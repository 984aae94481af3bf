"""Draw models side by side, from the front left and from the side, to look at what was baked.

    python -m tools.bake_assets.contact_sheet FOLDER OUT.png [KIND_OR_NAME ...]

Triangles seen from behind are magenta, unless their material has two sides. The bright line is 1 m long.
"""

import sys
from typing import Any

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from swardmap.synth.assets import Assets, open_assets
from swardmap.synth.model import Mesh, Model

TILE, COLUMNS = 220, 8
VERTEX = """#version 330
in vec3 at; in vec3 normal; in vec2 uv; uniform mat4 view; out vec3 n; out vec2 t;
void main() { gl_Position = view * vec4(at, 1.0); n = normal; t = vec2(uv.x, uv.y); }"""
FRAGMENT = """#version 330
in vec3 n; in vec2 t; out vec4 color; uniform vec3 tint; uniform int textured; uniform int two_sided;
uniform sampler2D picture; uniform vec3 eye;
void main() {
  vec4 c = textured == 1 ? texture(picture, t) : vec4(1.0);
  if (two_sided == 1 && c.a < 0.4) discard;
  vec3 m = normalize(n);
  if (two_sided == 1 && dot(m, eye) < 0) m = -m;
  float light = 0.35 + 0.75 * max(dot(m, normalize(vec3(0.4, 0.5, 0.8))), 0.0);
  color = vec4(pow(pow(c.rgb, vec3(2.2)) * tint * light, vec3(1.0 / 2.2)), 1.0);
  if (two_sided == 0 && !gl_FrontFacing) color = vec4(1, 0, 1, 1);
}"""


class Painter:
    """Draws one model at a time into a picture."""

    def __init__(self) -> None:
        self.context: Any = moderngl.create_context(standalone=True, backend="egl")
        self.program: Any = self.context.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
        self.target = self.context.simple_framebuffer((TILE * 2, TILE * 2), components=4)

    def draw(self, model: Model, yaw_deg: float, pitch_deg: float) -> NDArray[np.uint8]:
        """TILE x TILE x 3 RGB, with the model in the middle."""
        low, high = model.bounds_m()
        radius = float(np.linalg.norm(high - low)) / 2
        yaw, pitch = np.deg2rad((yaw_deg, pitch_deg))
        eye = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        right = np.array([-np.sin(yaw), np.cos(yaw), 0])
        turn = np.eye(4)
        turn[:3, :3] = np.stack((right, np.cross(eye, right), -eye)) / radius
        turn[:3, 3] = -turn[:3, :3] @ ((low + high) / 2)
        self.target.use()
        self.target.clear(0.80, 0.84, 0.88, 1)
        self.context.enable_only(moderngl.DEPTH_TEST)
        self.program["view"].write(turn.T.astype(np.float32).tobytes())
        self.program["eye"].value = tuple(eye)
        for mesh in (*model.meshes, _metre(low)):
            self._draw_mesh(mesh)
        picture = np.frombuffer(self.target.read(components=3), np.uint8).reshape(TILE * 2, TILE * 2, 3)[::-1]
        return np.asarray(cv2.resize(picture, (TILE, TILE), interpolation=cv2.INTER_AREA))

    def _draw_mesh(self, mesh: Mesh) -> None:
        content = np.concatenate((mesh.xyz, mesh.normals, mesh.uv), axis=1)[mesh.faces.reshape(-1)]
        buffer = self.context.buffer(np.ascontiguousarray(content, np.float32).tobytes())
        array = self.context.vertex_array(self.program, [(buffer, "3f 3f 2f", "at", "normal", "uv")])
        texture = mesh.material.texture
        self.program["tint"].value = mesh.material.color
        self.program["textured"].value = int(texture is not None)
        self.program["two_sided"].value = int(mesh.material.cutout)
        if texture is not None:
            rgba = texture.rgba
            picture = self.context.texture(rgba.shape[1::-1], 4, rgba[::-1].tobytes())
            picture.build_mipmaps()
            picture.use()
        array.render()
        for thing in (array, buffer, *([picture] if texture is not None else [])):
            thing.release()


def _metre(low: NDArray[np.float32]) -> Mesh:
    from swardmap.synth.model import Material
    from swardmap.synth.shapes import box, moved, placed

    bar = box((0.02, 1.0, 0.02), Material((1.0, 0.3, 0.0), cutout=True))
    return moved(bar, placed(float(low[0]), float(low[1]) + 0.5, float(low[2])))


def sheet(assets: Assets, names: list[str]) -> NDArray[np.uint8]:
    """All named models, each from the front left and from its left side."""
    painter, tiles = Painter(), []
    for name in names:
        model, entry = assets.model(name), assets.entry(name)
        for view, (yaw, pitch) in enumerate(((35, 20), (90, 3))):
            tile = painter.draw(model, yaw, pitch).copy()
            text = (
                name
                if view == 0
                else " ".join(f"{size:.2f}" for size in entry.size_m) + f" {entry.triangles}"
            )
            cv2.putText(tile, text, (4, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
            tiles.append(tile)
    while len(tiles) % COLUMNS:
        tiles.append(np.full_like(tiles[0], 255))
    rows = [np.concatenate(tiles[k : k + COLUMNS], axis=1) for k in range(0, len(tiles), COLUMNS)]
    return np.concatenate(rows)


def main() -> None:
    """Write a contact sheet."""
    assets, wanted = open_assets(sys.argv[1]), sys.argv[3:]
    names = [n for n in assets.names() if not wanted or n in wanted or assets.entry(n).kind in wanted]
    cv2.imwrite(sys.argv[2], sheet(assets, names)[..., ::-1])


if __name__ == "__main__":
    main()
