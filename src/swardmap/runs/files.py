"""The files of one run of `swardmap map`, written as the frames come.

OUT/map.yaml, map.pgm         the accumulated map (Nav2's map_server reads it)
OUT/costmap.yaml, costmap.pgm its costmap
OUT/living.npz                its evidence, where grid.mode is log_odds
OUT/report.html               a page about all of it, to be opened in a browser
OUT/map.png, costmap.png      pictures of both
OUT/frames/NAME.png           a picture of each n-th frame
OUT/clouds/NAME.pcd           labelled clouds in the map frame, if asked for
OUT/maps/NAME.yaml            standalone map of each frame, if asked for or if there are no poses;
                              NAME_semantic, NAME_geometry: each kind of evidence, if geometry is on
OUT/summary.json, config.yaml what was counted, and all settings used
"""

import json
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swardmap.config import Config, config_to_yaml
from swardmap.grid import OccupancyGrid
from swardmap.io.clouds.cloud_files import write_cloud
from swardmap.io.files import write_bytes, write_text
from swardmap.io.images import encode_png
from swardmap.io.maps.log_odds_files import write_living
from swardmap.io.maps.map_files import write_costmap, write_map
from swardmap.labels import MapClass
from swardmap.mapping.costmap import Costmap
from swardmap.mapping.log_odds_map import LogOddsMap
from swardmap.pipeline import ObstacleMapper, StepResult
from swardmap.viz.map_album import Album


class RunWriter:
    """Writes the results of a run into a folder.

    Args:
        folder: an existing empty folder.
        config: of the run; `config.output` says what to write.
        frame_count: of the recording, or None if it cannot be known.
    """

    def __init__(self, folder: Path, config: Config, frame_count: int | None = None) -> None:
        self._folder = folder
        self._config = config
        self._every = _every_nth(config.output.pictures, frame_count)
        self._frames = 0
        self._album = Album(bool(self._every), config.grid.resolution_m / 2)
        write_text(folder / "config.yaml", config_to_yaml(config), durable=False)

    def add(self, step: StepResult, mapper: ObstacleMapper) -> None:
        """Write what one frame gave."""
        output, name = self._config.output, _file_name(step, self._frames)
        self._frames += 1
        self._album.add(step.frame, step.segmentation, step.seen, step.T_map_camera)
        if output.clouds != "none":
            write_cloud(step.cloud(self._config), self._folder / "clouds" / f"{name}.{output.clouds}")
        if output.frame_maps or step.frame.T_map_camera is None:
            write_map(step.seen, self._folder / "maps" / f"{name}.yaml")
            if output.frame_maps and step.observation.geometry is not None:
                marks = np.where(step.observation.geometry.marks, np.uint8(MapClass.OBSTACLE), np.uint8(0))
                geometry = replace(step.seen, classes=marks)
                write_map(step.observation.semantic_grid, self._folder / "maps" / f"{name}_semantic.yaml")
                write_map(geometry, self._folder / "maps" / f"{name}_geometry.yaml")
        if self._every and (self._frames - 1) % self._every == 0:
            self._write_picture(name, step, mapper)

    def finish(
        self,
        grid: OccupancyGrid | None,
        costmap: Costmap | None,
        summary: dict[str, Any],
        log_odds: LogOddsMap | None = None,
    ) -> None:
        """Write the accumulated map, its evidence if it has any, and the summary."""
        from swardmap.viz.map_page import map_page
        from swardmap.viz.pictures import costmap_picture, map_picture

        if log_odds is not None:
            write_living(log_odds, self._folder / "living.npz", self._config)
        if grid is not None and costmap is not None:
            write_map(grid, self._folder / "map.yaml")
            write_costmap(costmap, self._folder / "costmap.yaml")
            if self._every:
                write_bytes(self._folder / "map.png", encode_png(map_picture(grid, costmap.costs)))
                write_bytes(self._folder / "costmap.png", encode_png(costmap_picture(costmap)))
        page = map_page(
            grid, costmap, self._album, summary, config_to_yaml(self._config, comments=False), typed_command()
        )
        write_text(self._folder / "report.html", page, durable=False)
        write_text(self._folder / "summary.json", json.dumps(summary, indent=2) + "\n")

    def _write_picture(self, name: str, step: StepResult, mapper: ObstacleMapper) -> None:
        from swardmap.viz.pictures import frame_picture

        costmap = mapper.costmap(step.seen)
        picture = frame_picture(
            step.frame,
            step.segmentation,
            step.cloud(self._config),
            step.seen,
            costs=None if costmap is None else costmap.costs,
            T_map_camera=step.T_map_camera,
            by_geometry=step.observation.by_geometry,
        )
        write_bytes(self._folder / "frames" / f"{name}.png", encode_png(picture), durable=False)


def typed_command() -> str | None:
    """The command line that is running, if it is one of swardmap."""
    program = Path(sys.argv[0]) if sys.argv else Path()
    ours = program.name == "swardmap" or program.parts[-2:] == ("swardmap", "__main__.py")
    return shlex.join(["swardmap", *sys.argv[1:]]) if ours else None


def _every_nth(configured: int | None, frame_count: int | None) -> int:
    """Of which n-th frame a picture is made: one takes many times as long as mapping the frame."""
    if configured is not None:
        return configured
    return 10 if frame_count is None else max(1, round(frame_count / 50))


def _file_name(step: StepResult, index: int) -> str:
    """A safe file name: the frame's own if it is one, else its number."""
    name = step.frame.name
    plain = name and all(c.isalnum() or c in "-_." for c in name) and not name.startswith(".")
    return name if plain else f"{index:06d}"
