"""What is drawn into: the picture with its samples, the truth at pixel centres, the finished picture."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.synth.model import Float32Array
from swardmap.synth.render.context import Context

NEAREST = 0x2600


def scale_of(samples: int) -> int:
    """Picture elements along the edge of a pixel: 1, 2, 3 or 4 for 1, 4, 9 or 16 samples.

    Each element is shaded. Multisampling would shade less, yet on Mesa's software driver it takes longer:
    blades of grass are smaller than a pixel, and their edges cost more than the shading.
    """
    return max(1, round(math.sqrt(samples)))


class Targets:
    """Framebuffers of one size.

    Attributes:
        scale: see `scale_of`.
        picture: radiance, all samples.
        truth: depth and ids at pixel centres.
        both: radiance, depth and ids at pixel centres, in one pass.
        occluded: how much of the sky is hidden, 0 = nothing.
        finished: radiance of each pixel.
    """

    def __init__(self, context: Context, width: int, height: int, samples: int) -> None:
        self.scale = scale_of(samples)
        self.size = (width, height)
        full = (width * self.scale, height * self.scale)

        def texture(size: tuple[int, int], components: int, dtype: str) -> Any:
            made = context.texture(size, components, dtype=dtype)
            made.filter = (NEAREST, NEAREST)
            return made

        self.samples = texture(full, 4, "f2")
        self.plain = texture(self.size, 4, "f2") if self.scale > 1 else self.samples
        self.depth = texture(self.size, 1, "f4")
        self.ids = texture(self.size, 2, "u2")
        self._result = texture(self.size, 4, "f4")
        self.occlusion = texture(self.size, 1, "f1")
        own = context.depth_renderbuffer(self.size)
        self.picture: Any = context.framebuffer([self.samples], context.depth_renderbuffer(full))
        self.truth: Any = context.framebuffer([self.depth, self.ids], own)
        self.both: Any = context.framebuffer([self.plain, self.depth, self.ids], own)
        self.occluded: Any = context.framebuffer([self.occlusion])
        self.finished: Any = context.framebuffer([self._result])

    def radiance(self) -> Float32Array:
        """H x W x 3 of the finished picture."""
        data = self.finished.read(components=3, dtype="f4", alignment=1)
        return np.frombuffer(data, np.float32).reshape(*self.size[::-1], 3).copy()

    def exact(self) -> tuple[Float32Array, NDArray[np.uint8], NDArray[np.uint16]]:
        """Depth, label and thing of each pixel."""
        w, h = self.size
        depth = np.frombuffer(self.depth.read(alignment=1), np.float32).reshape(h, w).copy()
        ids = np.frombuffer(self.ids.read(alignment=1), np.uint16).reshape(h, w, 2)
        return depth, ids[..., 0].astype(np.uint8), ids[..., 1].copy()
