"""Which side of each triangle is seen from outside, by drawing it from many directions (moderngl, EGL)."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

DIRECTIONS, PIXELS = 60, 512
VERTEX = """#version 330
in vec3 at; uniform mat4 turn; flat out int face;
void main() { gl_Position = turn * vec4(at, 1.0); face = gl_VertexID / 3; }"""
FRAGMENT = """#version 330
flat in int face; out ivec2 seen;
void main() { seen = ivec2(face + 1, gl_FrontFacing ? 1 : 0); }"""


def seen_pixels(triangles: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pixels in which the front and the back of each triangle are seen, over directions all around.

    Args:
        triangles: m x 3 x 3; the front is the side from which they run counter-clockwise.

    Returns:
        m each: of the front, of the back.
    """
    context, program, target = _machine()
    middle = (triangles.min(axis=(0, 1)) + triangles.max(axis=(0, 1))) / 2
    radius = float(np.linalg.norm(triangles.reshape(-1, 3) - middle, axis=1).max()) or 1.0
    buffer = context.buffer(np.ascontiguousarray((triangles - middle) / radius, np.float32).tobytes())
    array = context.vertex_array(program, [(buffer, "3f", "at")])
    front, back = np.zeros(len(triangles) + 1, np.int64), np.zeros(len(triangles) + 1, np.int64)
    target.use()
    context.enable_only(context.DEPTH_TEST)
    for turn in _turns():
        target.clear(0, 0, 0, 0, depth=1.0)
        program["turn"].write(turn.T.astype(np.float32).tobytes())
        array.render()
        seen = np.frombuffer(target.read(components=2, dtype="i4"), np.int32).reshape(-1, 2)
        front += np.bincount(seen[seen[:, 1] == 1, 0], minlength=len(front))
        back += np.bincount(seen[seen[:, 1] == 0, 0], minlength=len(back))
    array.release()
    buffer.release()
    return front[1:], back[1:]


@cache
def _machine() -> tuple[Any, Any, Any]:
    import moderngl

    context = moderngl.create_context(standalone=True, backend="egl")
    color = context.texture((PIXELS, PIXELS), 2, dtype="i4")
    target = context.framebuffer([color], context.depth_renderbuffer((PIXELS, PIXELS)))
    return context, context.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT), target


def _turns() -> list[NDArray[np.float64]]:
    """Parallel projections from points spread evenly over the sphere (Fibonacci)."""
    k = np.arange(DIRECTIONS) + 0.5
    z, lon = 1 - 2 * k / DIRECTIONS, np.pi * (1 + 5**0.5) * k
    towards = np.stack((np.sqrt(1 - z * z) * np.cos(lon), np.sqrt(1 - z * z) * np.sin(lon), z), axis=1)
    turns = []
    for w in towards:
        u = np.cross([0, 0, 1.0] if abs(w[2]) < 0.9 else [1.0, 0, 0], w)
        u /= np.linalg.norm(u)
        turn = np.eye(4)
        turn[:3, :3] = np.stack((u, np.cross(w, u), -w * 0.99))
        turns.append(turn)
    return turns
