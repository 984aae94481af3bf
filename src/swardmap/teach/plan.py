"""What `swardmap teach` is told, and the limits by which a drive becomes labels."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swardmap.config.settings import Checked, setting
from swardmap.errors import ConfigError

Corners = NDArray[np.float64]
"""(N, 2) metres in the robot's base frame: x forward, y left."""

CIRCLE_CORNERS = 24


@dataclass(frozen=True)
class LabelConfig(Checked):
    """By which a pixel of the drive gets its class; heights are above the local ground of the view."""

    flat_m: float = setting(0.05, "so near to the ground is ground", minimum=0.005)
    raised_m: float = setting(0.08, "what rises more is no grass, where nobody drove", minimum=0.01)
    raised_driven_m: float = setting(
        0.12, "the same where the robot drove: what is lower bent under it", minimum=0.01
    )
    hole_m: float = setting(0.15, "what lies so far below the ground is no grass", minimum=0.01)
    near_m: float = setting(5.0, "farther away nothing is called grass", minimum=0.5)
    beside_m: float = setting(0.10, "so near to something raised no ground is called grass", minimum=0)
    open_beside_m: float = setting(
        0.30,
        "so near to something raised, in most views, a network's word for grass counts nowhere",
        minimum=0,
    )
    cell_pixels: float = setting(2.0, "pixels of a driven cell that a frame teaches, on average", minimum=0.1)
    sure: float = setting(0.9, "from this on the network's word about flat ground counts", minimum=0.5)
    person: float = setting(0.6, "from this on its word for a person", minimum=0, maximum=1)
    apart_m: float = setting(0.25, "way of the camera between two frames that are learnt from", minimum=0)
    most_frames: int = setting(160, "frames of a drive that are learnt from, about", minimum=8)
    held_out: float = setting(0.2, "last part of the drive that is measured on", minimum=0.05, maximum=0.5)


@dataclass(frozen=True)
class LearnConfig(Checked):
    """How it learns; small, so that two cores need minutes."""

    steps: int = setting(240, "of the optimiser", minimum=1)
    batch: int = setting(8, "views a step", minimum=1)
    decoder_rate: float = setting(1e-3, "learning rate at its peak", minimum=0)
    encoder_rate: float = setting(0.0, "learning rate at its peak; 0 = it stays as it is", minimum=0)
    driven_share: float = setting(
        0.3,
        "weight of all driven pixels in the loss, of that of all pixels of the drive",
        minimum=0,
        maximum=1,
    )
    known_weight: float = setting(
        3.0, "of what is no lawn in the replay: driven ground shall not drag paths and beds along", minimum=0
    )
    replay: float = setting(0.5, "share of the views that are not of the drive", minimum=0, maximum=0.95)
    again: float = setting(
        0.5,
        "as many of these steps once more, with what the network is sure of by then about ground not driven",
        minimum=0,
        maximum=10,
    )
    kept_batches: int = setting(
        40,
        "batches of views that are drawn, then learnt from again and again while the encoder stays as it is",
    )
    check_every: int = setting(80, "steps from one checkpoint to the next", minimum=1)

    @property
    def again_steps(self) -> int:
        """Steps of the second round."""
        return round(self.again * self.steps)

    @property
    def total_steps(self) -> int:
        """Of both rounds."""
        return self.steps + self.again_steps


@dataclass(frozen=True, eq=False)
class TeachPlan:
    """All but the recordings and where to write.

    Attributes:
        footprint_m: the part of the robot's outline that certainly touched the ground, in its base frame.
        leave_out_s: (from, to) seconds after a recording's first frame that nothing is learnt from.
        labels, learn: see there.
    """

    footprint_m: Corners
    leave_out_s: tuple[tuple[float, float], ...] = ()
    labels: LabelConfig = field(default_factory=LabelConfig)
    learn: LearnConfig = field(default_factory=LearnConfig)


def circle(radius_m: float) -> Corners:
    """(N, 2) a footprint within a circle about the robot's base."""
    turn = np.arange(CIRCLE_CORNERS) * (2 * np.pi / CIRCLE_CORNERS)
    return radius_m * np.column_stack([np.cos(turn), np.sin(turn)])


def read_span(text: str) -> tuple[float, float]:
    """A time span of the command line.

    >>> read_span("12.5-20")
    (12.5, 20.0)

    Raises:
        ConfigError: for anything else.
    """
    begin, sign, end = text.partition("-")
    try:
        span = float(begin), float(end)
    except ValueError:
        span = 0.0, 0.0
    if not sign or not 0 <= span[0] < span[1] < 1e9:
        raise ConfigError(f"expected a time span in seconds such as 12.5-20, got '{text[:60]}'")
    return span
