"""How a lawn looks: hue, length, density and dryness, from 178 photos of real grass.

Of the mean colour of the grass of each photo (MSRC v2, sRGB) the 5th to 95th percentile is: hue 55-93
degrees (median 71), saturation 0.27-0.67 (0.49), value 0.28-0.76 (0.49), and value falls with saturation
(r = -0.51). Photos are exposed, albedo is not: the value is therefore taken from reflectances of turf in the
visible (about 0.08-0.2 in green).
"""

import colorsys
from dataclasses import dataclass

import numpy as np

RGB = tuple[float, float, float]
HUE_DEG, SATURATION, VALUE = (60.0, 93.0), (0.30, 0.66), (0.32, 0.48)
SOIL: RGB = (0.16, 0.11, 0.07)
STRAW: RGB = (0.33, 0.27, 0.135)


@dataclass(frozen=True, slots=True)
class LawnLook:
    """What kind of lawn it is.

    Attributes:
        hue_deg, saturation, value: sRGB HSV of its mean colour.
        height_m: mean length of the blades.
        density: share of the full density.
        dry: share of the area that is dried out, about.
        stripe: contrast of mowing stripes; 0 = none.
        stripe_m: width of a stripe.
        stripe_rad: their direction.
        moss, clover, bare, worn: strength, 0 = none to 1.
        tracks: whether wheels left lines.
    """

    hue_deg: float
    saturation: float
    value: float
    height_m: float
    density: float
    dry: float
    stripe: float
    stripe_m: float
    stripe_rad: float
    moss: float
    clover: float
    bare: float
    worn: float
    tracks: bool

    @property
    def color(self) -> RGB:
        """Linear RGB of its mean."""
        return linear_of_hsv(self.hue_deg, self.saturation, self.value)


def lawn_look(rng: np.random.Generator) -> LawnLook:
    """A lawn by chance, within what photos show."""
    hue = float(np.clip(rng.normal(75, 8), *HUE_DEG))
    saturation = float(np.clip(rng.normal(0.5, 0.09), *SATURATION))
    value = float(np.clip(rng.normal(0.40 - 0.25 * (saturation - 0.5), 0.035), *VALUE))
    height = float(np.exp(rng.uniform(np.log(0.02), np.log(0.12))))
    some = rng.random(6)
    strength = rng.uniform(0.3, 1.0, 6)
    striped = some[0] < 0.45 and height < 0.07
    return LawnLook(
        hue, saturation, value, height, float(rng.uniform(0.55, 1.0)),
        dry=float(rng.choice([0.02, 0.1, 0.3, 0.6], p=(0.4, 0.35, 0.17, 0.08))),
        stripe=float(0.2 * strength[0]) if striped else 0.0,
        stripe_m=float(rng.uniform(0.35, 0.6)), stripe_rad=float(rng.uniform(0, np.pi)),
        moss=float(strength[1]) if some[1] < 0.4 else 0.0,
        clover=float(strength[2]) if some[2] < 0.45 else 0.0,
        bare=float(strength[3]) if some[3] < 0.35 else 0.0,
        worn=float(strength[4]) if some[4] < 0.45 else 0.0,
        tracks=bool(some[5] < 0.3),
    )  # fmt: skip


def linear_of_hsv(hue_deg: float, saturation: float, value: float) -> RGB:
    """Linear RGB of an sRGB colour given by hue, saturation and value."""
    srgb = colorsys.hsv_to_rgb(hue_deg % 360 / 360, saturation, value)
    r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in srgb)
    return r, g, b
