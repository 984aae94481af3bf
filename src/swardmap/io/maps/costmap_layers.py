"""The layers of a costmap, in their order, and how each comes from the configuration.

A new layer is one file, a dataclass with `frame_id` and `apply` (`swardmap.mapping.costmap.Layer`), and one
entry here.
"""

from collections.abc import Callable, Mapping

from swardmap.config import Config
from swardmap.io.maps.area_files import read_area
from swardmap.io.maps.keepout_mask import read_keepout
from swardmap.mapping.costmap import InflationLayer, Layer, ObstacleLayer

LAYERS: Mapping[str, Callable[[Config], Layer | None]] = {
    "obstacles": lambda _: ObstacleLayer(),
    "work area": lambda config: read_area(config.area),
    "keep-out mask": lambda config: read_keepout(config.area),
    "inflation": lambda config: InflationLayer(config.costmap),
}
"""Name -> what makes the layer, or None where the configuration does not ask for it; the lowest first."""

SEEN = ("obstacles", "inflation")
"""Around every costmap, and made anew when a margin changes."""


def zone_layers(config: Config) -> tuple[Layer, ...]:
    """The layers between what is seen and its inflation: they are read once, before the first frame.

    Raises:
        InputError: if a file cannot be read or says nothing that holds together.
        MissingExtraError: for a work area in GPS coordinates without pyproj.
    """
    made = (make(config) for name, make in LAYERS.items() if name not in SEEN)
    return tuple(layer for layer in made if layer is not None)
