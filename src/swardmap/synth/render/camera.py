"""The pinhole camera as OpenGL has it, and what of the frame all shaders know."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Intrinsics, Pose
from swardmap.synth.model import Float64Array, Light

NEAR_M, FAR_M = 0.03, 400.0


@dataclass(frozen=True, slots=True, eq=False)
class RenderCamera:
    """A camera at a place.

    Shaders work in `rel`: the axes of the map, the origin at the camera, so that float32 is exact to
    micrometres where it matters. Row 0 of the picture is row 0 of OpenGL's, the other way up than usual.

    Attributes:
        intrinsics: of the picture.
        position_m: (3,) in the map.
        axes: 3 x 3, columns right, down, forward in the map.
    """

    intrinsics: Intrinsics
    position_m: Float64Array
    axes: Float64Array

    @classmethod
    def of(cls, intrinsics: Intrinsics, T_map_camera: Pose) -> "RenderCamera":
        """From a pose of an optical frame."""
        return cls(intrinsics, T_map_camera.matrix[:3, 3], T_map_camera.matrix[:3, :3])

    @property
    def clip_from_rel(self) -> Float64Array:
        """4 x 4: pixel (u, v) lands on the centre of fragment (u, v)."""
        k = self.intrinsics
        w, h, n, f = k.width, k.height, NEAR_M, FAR_M
        clip = np.zeros((4, 4))
        clip[0, :3] = 2 * k.fx / w, 0, (2 * k.cx + 1) / w - 1
        clip[1, :3] = 0, 2 * k.fy / h, (2 * k.cy + 1) / h - 1
        clip[2, 2:] = (f + n) / (f - n), -2 * f * n / (f - n)
        clip[3, 2] = 1
        view = np.eye(4)
        view[:3, :3] = self.axes.T
        return clip @ view

    def sees(self, centres_m: Float64Array, radii_m: Float64Array, far_m: float = FAR_M) -> NDArray[np.bool_]:
        """Which spheres may be in the picture.

        Args:
            centres_m: n x 3 in the map.
            radii_m: n.
            far_m: farther ones are not.
        """
        k = self.intrinsics
        at = (centres_m - self.position_m) @ self.axes
        seen: NDArray[np.bool_] = (at[:, 2] > NEAR_M - radii_m) & (at[:, 2] < far_m + radii_m)
        sides = (
            (k.fx, 0, k.cx + 0.5), (-k.fx, 0, k.width - k.cx - 0.5),
            (0, k.fy, k.cy + 0.5), (0, -k.fy, k.height - k.cy - 0.5),
        )  # fmt: skip
        for side in sides:
            plane = np.array(side)
            seen &= at @ (plane / np.linalg.norm(plane)) > -radii_m
        return seen


def columns(matrix: Float64Array) -> bytes:
    """A matrix as OpenGL wants it: column by column, float32."""
    return np.ascontiguousarray(matrix.T, np.float32).tobytes()


def moved_by(translation_m: Float64Array) -> Float64Array:
    """4 x 4 translation."""
    T = np.eye(4)
    T[:3, 3] = translation_m
    return T


def frame_block(
    camera: RenderCamera, light: Light, shadows: tuple[Float64Array, Float64Array], soft: tuple[float, float],
    scale: int, phase: float,
) -> bytes:  # fmt: skip
    """Contents of the uniform block Frame.

    Args:
        camera: of the picture.
        light: of the scene.
        shadows: from the map to the near and the far shadow map, 0..1.
        soft: half-shadow in both, as share of their edges.
        scale: picture elements along the edge of a pixel.
        phase: 0..1, by which skies differ.
    """
    k, T = camera.intrinsics, moved_by(camera.position_m)
    matrices = [camera.clip_from_rel, shadows[0] @ T, shadows[1] @ T]
    rows = [
        *camera.axes.T, (k.fx, k.fy, k.cx, k.cy), camera.position_m, light.sun_direction, light.sun,
        light.zenith, light.horizon, light.bounce, (light.haze_per_m, light.clouds, *soft),
        (scale, k.width, k.height, phase),
    ]  # fmt: skip
    vectors = np.zeros((len(rows), 4), np.float32)
    for vector, row in zip(vectors, rows, strict=True):
        vector[: len(row)] = row
    return b"".join(columns(matrix) for matrix in matrices) + vectors.tobytes()
