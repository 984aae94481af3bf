"""swardmap: from RGB-D to an obstacle map a mowing robot can trust.

The names below are what most programs need; each is loaded when it is first used, so that importing
swardmap costs nothing. Sources and files live in `swardmap.io`, segmenters in `swardmap.models`,
pictures in `swardmap.viz`, the bare array functions in `swardmap.perception.cloud`, `grid` and `costmap`.
"""

import importlib
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swardmap.config import Config as Config
    from swardmap.config import load_config as load_config
    from swardmap.errors import SwardmapError as SwardmapError
    from swardmap.geometry import Intrinsics as Intrinsics
    from swardmap.geometry import Pose as Pose
    from swardmap.grid import GridSpec as GridSpec
    from swardmap.grid import OccupancyGrid as OccupancyGrid
    from swardmap.io import open_source as open_source
    from swardmap.io.maps.map_files import write_costmap as write_costmap
    from swardmap.io.maps.map_files import write_map as write_map
    from swardmap.labels import LabelSet as LabelSet
    from swardmap.labels import MapClass as MapClass
    from swardmap.mapping.costmap import Costmap as Costmap
    from swardmap.mapping.costmap import build_costmap as build_costmap
    from swardmap.models import build_segmenter as build_segmenter
    from swardmap.pipeline import ObstacleMapper as ObstacleMapper
    from swardmap.runs.recording import map_recording as map_recording
    from swardmap.types import Frame as Frame
    from swardmap.types import LabeledCloud as LabeledCloud
    from swardmap.types import Segmentation as Segmentation

__version__ = "0.1.0"

# ONNX Runtime otherwise sends reports to its maker, and keeps a device id in the user's home
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "true")

_HOME = {
    "Config": "config", "load_config": "config", "Costmap": "mapping.costmap",
    "build_costmap": "mapping.costmap",
    "SwardmapError": "errors", "Intrinsics": "geometry", "Pose": "geometry", "GridSpec": "grid",
    "OccupancyGrid": "grid", "open_source": "io", "LabelSet": "labels", "MapClass": "labels",
    "build_segmenter": "models", "ObstacleMapper": "pipeline", "map_recording": "runs.recording",
    "write_costmap": "io.maps.map_files", "write_map": "io.maps.map_files",
    "Frame": "types", "LabeledCloud": "types", "Segmentation": "types",
}  # fmt: skip

__all__ = ["__version__", *_HOME]


def __getattr__(name: str) -> Any:
    """Load a name of the table from its module (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module 'swardmap' has no attribute '{name}'")
    return getattr(importlib.import_module(f"swardmap.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    """Names for tab completion."""
    return sorted([*globals(), *_HOME])
