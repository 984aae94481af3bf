"""How a predicted map and its reference are made comparable: settings of both, by protocol (Sec. 4.3)."""

from dataclasses import replace
from functools import lru_cache

from swardmap.config import Config, GeometryConfig
from swardmap.errors import InvalidValueError

PROTOCOLS = ("dense", "paper", "paper-own")
"""dense: the reference takes every valid pixel, unfiltered, of the clean depth where there is one, by its
height above the true ground. paper: the reference takes the predicted map's depth, filter and
downsampling; the predicted map is the one that the robot makes. paper-own: one point is enough for a cell
of either map, as in the paper, so that both agree on what is unknown (Table 6)."""


@lru_cache(maxsize=32)  # building a configuration checks every setting
def protocol_configs(config: Config, protocol: str) -> tuple[Config, Config]:
    """Settings of the reference map and of the predicted map in the paper's protocols.

    Range and height limits stay in both: they say what the map is about. The reference takes the same
    filter, one point a cell, and nothing but the labels. With `paper-own` one point is enough for a cell of
    either map: otherwise a cell of two grass points and one obstacle point would be unknown in one map and
    not in the other.

    Args:
        config: of the robot.
        protocol: `paper` or `paper-own`.
    """
    same = replace(config, grid=replace(config.grid, min_points=1, min_grass_points=1))
    reference = replace(same, geometry=labels_alone(config.geometry))
    if protocol == "paper":
        return reference, config
    if protocol == "paper-own":
        return reference, replace(same, geometry=labels_alone(config.geometry))
    raise InvalidValueError(f"expected a protocol of paper, paper-own, got '{protocol}'")


def labels_alone(geometry: GeometryConfig) -> GeometryConfig:
    """The same ground, and no marks from depth: the truth is what the labels say."""
    return replace(geometry, enabled=False, semantics=True)


@lru_cache(maxsize=32)
def at_resolution(config: Config, resolution_m: float) -> Config:
    """The same settings with cells of another size."""
    return replace(config, grid=replace(config.grid, resolution_m=resolution_m))
