"""What is drawn into: the anti-aliased picture, the truth at pixel centres, the finished picture."""

from typing import Any

import numpy as np

from swardmap.synth.model import Float32Array
from swardmap.synth.render.context import Context


def sampling_of(samples: int, most: int) -> tuple[int, int]:
    """How to take samples: multisamples of a picture element, and elements along the edge of a pixel.

    Args:
        samples: wanted for a pixel.
        most: multisamples that the driver has.
    """
    multi = max(m for m in (1, 2, 4, 8, 16) if m == 1 or (m <= most and m <= samples))
    return multi, max(1, round((samples / multi) ** 0.5))


class Targets:
    """Framebuffers of one size.

    Attributes:
        multi, scale: see `sampling_of`.
        picture: radiance, anti-aliased.
        truth: depth and ids at pixel centres.
        both: all of it at pixel centres, in one pass.
    """

    def __init__(self, context: Context, width: int, height: int, samples: int) -> None:
        self._context = context
        self.multi, self.scale = sampling_of(samples, context.max_samples)
        size, full = (width, height), (width * self.scale, height * self.scale)
        multi = self.multi if self.multi > 1 else 0
        self.picture: Any = context.framebuffer(
            [context.renderbuffer(full, 4, samples=multi, dtype="f2")],
            context.depth_renderbuffer(full, samples=multi),
        )
        self.plain = context.texture(size, 4, dtype="f2")
        self.depth = context.texture(size, 1, dtype="f4")
        self.ids = context.texture(size, 2, dtype="u2")
        for texture in (self.plain, self.depth, self.ids):
            nearest = 0x2600  # GL_NEAREST
            texture.filter = (nearest, nearest)
        self.truth: Any = context.framebuffer([self.depth, self.ids], context.depth_renderbuffer(size))
        self.both: Any = context.framebuffer(
            [self.plain, self.depth, self.ids], context.depth_renderbuffer(size)
        )
        self._resolved = context.framebuffer([self.plain])
        self._whole = context.framebuffer([context.renderbuffer(full, 4, dtype="f2")])
        self.result = context.texture(size, 4, dtype="f4")
        self.finished: Any = context.framebuffer([self.result])

    def resolve(self) -> None:
        """Average the samples of `picture` into `plain`."""
        if self.scale == 1:
            self._context.copy_framebuffer(self._resolved, self.picture)
            return
        self._context.copy_framebuffer(self._whole, self.picture)
        h, w, s = self.plain.height, self.plain.width, self.scale
        rgba = np.frombuffer(self._whole.read(components=4, dtype="f2"), np.float16)
        mean = rgba.reshape(h, s, w, s, 4).mean(axis=(1, 3), dtype=np.float32)
        self.plain.write(mean.astype(np.float16).tobytes())

    def radiance(self) -> Float32Array:
        """H x W x 3 of the finished picture."""
        h, w = self.result.height, self.result.width
        data = self.finished.read(components=3, dtype="f4", alignment=1)
        return np.frombuffer(data, np.float32).reshape(h, w, 3).copy()
