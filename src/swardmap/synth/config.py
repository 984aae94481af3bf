"""All settings of the garden: rig, camera, depth sensor, maps; ranges are drawn from once a sequence.

Order of precedence: defaults < file (`--config`) < command line (`--set camera.jpeg_quality=[80,95]`).
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from hashlib import sha256
from pathlib import Path
from typing import Any

from swardmap.config.loader import load
from swardmap.config.settings import Checked, setting
from swardmap.errors import ConfigError, shortened


def span(low: float, high: float, about: str, minimum: float | None = None) -> Any:
    """Declare a range that a number is drawn from, once a sequence."""
    limits = {"about": about, "minimum": None, "maximum": None, "choices": None, "lowest": minimum}
    return field(default=(low, high), metadata=limits)


class CheckedRanges(Checked):
    """Checks ranges too: in order, and not below what they may be."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for f in fields(self):  # type: ignore[arg-type]
            value, lowest = getattr(self, f.name), f.metadata.get("lowest")
            if not isinstance(value, tuple):
                continue
            name = f"{type(self).__name__}.{f.name}"
            if value[0] > value[1]:
                raise ConfigError(f"{name}: expected [low, high], got {list(value)}")
            if lowest is not None and value[0] < lowest:
                raise ConfigError(f"{name}: expected at least {lowest:g}, got {value[0]:g}")


MOST_TIMES = 20.0


def read_more(text: str) -> dict[str, float]:
    """How many times as often each kind of thing is wished for, from `kind=times` with commas between.

    Raises:
        ConfigError: for other text, a kind twice, an unknown one, or a number that is not in 0..20.
    """
    from swardmap.synth.scene.recipes import KINDS

    more: dict[str, float] = {}
    for entry in filter(str.strip, text.split(",")):
        kind, _, times = (part.strip() for part in entry.partition("="))
        if not re.fullmatch(r"\d{1,2}(\.\d{1,6})?", times) or float(times) > MOST_TIMES or kind in more:
            raise ConfigError(
                f"scene.more: expected kind=times, each kind once, from 0 to {MOST_TIMES:g} times, as "
                f"'tree=5,hose=4', got {shortened(text)}"
            )
        if kind not in KINDS:
            raise ConfigError(
                f"scene.more: unknown kind {shortened(kind)}; known: {', '.join(sorted(KINDS))}"
            )
        more[kind] = float(times)
    return more


@dataclass(frozen=True)
class SceneConfig(Checked):
    """The gardens."""

    assets: bool = setting(True, "false: without ready-made models, all is drawn from simple shapes")
    more: str = setting(
        "", "how many times as much of a kind of thing, or of ground cover: tree=5,hose=4,test body=0"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        read_more(self.more)


@dataclass(frozen=True)
class RigConfig(CheckedRanges):
    """The camera on the mower; height, pitch and lens are drawn once a garden."""

    width: int = setting(640, "of the image in pixels", minimum=32, maximum=4096)
    height: int = setting(480, "of the image in pixels", minimum=32, maximum=4096)
    samples: int = setting(4, "anti-aliasing: samples a pixel", minimum=1, maximum=16)
    rate_hz: float = setting(5.0, "frames a second", minimum=0.1, maximum=60)


@dataclass(frozen=True)
class OpticsConfig(CheckedRanges):
    """What optics, sensor and processing do to the colour image."""

    faults: bool = setting(True, "false: a clean picture, exposed well")
    exposure_ev: tuple[float, float] = span(
        -1.0, 1.0, "error of the exposure in stops; the middle is likeliest"
    )
    white_balance: tuple[float, float] = span(
        -0.1, 0.1, "error of the white balance: log of red against blue"
    )
    tint: tuple[float, float] = span(-0.03, 0.03, "error of the white balance: log of green against the rest")
    saturation: tuple[float, float] = span(0.85, 1.05, "of colours", 0.0)
    contrast: tuple[float, float] = span(-0.05, 0.35, "of the tone curve; 0 = plain sRGB")
    knee: tuple[float, float] = span(0.55, 0.85, "from here on highlights are compressed, 0..1", 0.05)
    vignetting: tuple[float, float] = span(0.0, 0.35, "light lost in the corners, 0..1", 0.0)
    dirt: tuple[float, float] = span(-2.0, 4.0, "specks of dirt on the lens, their number; below 0.5 none")
    raindrops: tuple[float, float] = span(-12.0, 4.0, "drops on the lens, their number; below 0.5 none")
    veil: tuple[float, float] = span(0.0, 0.05, "stray light, as share of the mean", 0.0)
    shot_noise: tuple[float, float] = span(0.004, 0.018, "standard deviation at full signal in daylight", 0.0)
    read_noise: tuple[float, float] = span(0.0004, 0.002, "standard deviation in the dark in daylight", 0.0)
    softness_px: tuple[float, float] = span(0.3, 0.7, "blur of lens and demosaicing, sigma", 0.0)
    aberration: tuple[float, float] = span(
        0.0, 0.0008, "difference in size of the red and the blue image", 0.0
    )
    blur_share: float = setting(0.3, "share of the frames with motion blur", minimum=0, maximum=1)
    shutter_s: tuple[float, float] = span(0.004, 0.03, "exposure time of frames with motion blur", 0.0)
    blur_steps: int = setting(4, "pictures averaged for motion blur", minimum=2, maximum=16)
    jpeg_quality: tuple[float, float] = span(70.0, 98.0, "1..100; 0 = no compression", 0.0)


@dataclass(frozen=True)
class StereoConfig(CheckedRanges):
    """The depth sensor, like a D435i; docs/garden.md has the sources."""

    enabled: bool = setting(True, "false: depth of the folder layout is exact")
    baseline_m: float = setting(0.05, "between the imagers", minimum=0.001)
    focal_px: float = setting(424.0, "of the infrared imagers at 848 x 480, 90 degrees", minimum=1)
    subpixel_px: tuple[float, float] = span(
        0.05, 0.12, "noise of the disparity on well textured surfaces", 0.0
    )
    step_px: float = setting(1 / 32, "smallest step of the disparity", minimum=1e-4)
    scale_error: tuple[float, float] = span(-0.01, 0.01, "error of the calibration: share of the depth")
    offset_px: tuple[float, float] = span(-0.02, 0.02, "error of the calibration: of the disparity")
    window_px: int = setting(7, "edge of the matching window", minimum=1, maximum=31)
    fattening: float = setting(
        0.35, "share of the window a near surface needs to win; lower = fatter", minimum=0.05, maximum=0.95
    )
    edge_px: float = setting(1.0, "range of disparities in a window that is an edge", minimum=0.01)
    flying: tuple[float, float] = span(
        0.05, 0.25, "share of edge pixels that float between front and back", 0.0
    )
    dropout: tuple[float, float] = span(0.0, 0.04, "share of well textured pixels in holes", 0.0)
    heavy_loss_share: float = setting(0.1, "share of the frames that lose far more", minimum=0, maximum=1)
    heavy_dropout: tuple[float, float] = span(0.08, 0.25, "share of pixels in holes in such a frame", 0.0)
    blank_dropout: float = setting(0.7, "share of holes where there is no texture", minimum=0, maximum=1)
    texture_full: float = setting(0.03, "local contrast, 0..1, from which on noise is least", minimum=1e-4)
    dark: float = setting(0.03, "grey below it (0..1) gives holes", minimum=0, maximum=1)
    saturated: float = setting(0.985, "grey above it (0..1) gives holes", minimum=0, maximum=1)
    min_m: float = setting(0.28, "nearest reading", minimum=0)
    max_m: float = setting(10.0, "farthest reading", minimum=0.1, maximum=65)
    speckle_px: int = setting(40, "islands of fewer pixels are removed; 0 = none", minimum=0)


@dataclass(frozen=True)
class MapConfig(Checked):
    """The reference maps."""

    enabled: bool = setting(True, "write a map of each scene and each frame")
    resolution_m: float = setting(0.05, "edge of a cell", minimum=0.005, maximum=1)
    max_height_m: float = setting(2.0, "what hangs higher above the ground is driven under", minimum=0.1)
    min_height_m: float = setting(0.01, "what is flatter is driven over", minimum=0)
    range_m: float = setting(8.0, "a frame's map ends at this depth", minimum=0.5)


@dataclass(frozen=True)
class SynthConfig(Checked):
    """The whole tree."""

    scene: SceneConfig = field(default_factory=SceneConfig)
    rig: RigConfig = field(default_factory=RigConfig)
    camera: OpticsConfig = field(default_factory=OpticsConfig)
    stereo: StereoConfig = field(default_factory=StereoConfig)
    map: MapConfig = field(default_factory=MapConfig)


def load_synth_config(file: Path | None = None, overrides: Iterable[str] = ()) -> SynthConfig:
    """Build the configuration: defaults < file < overrides (`section.key=value`, values in YAML).

    Raises:
        ConfigError: for an unknown key, a wrong type, or a value out of range.
    """
    return load(SynthConfig, file, None, overrides)


def digest(plain: Mapping[str, Any]) -> str:
    """16 hex digits that tell settings apart."""
    import json

    return sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:16]
