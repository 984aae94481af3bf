"""Depth 2 of the API: frame by frame, with your own segmenter.

python examples/step_by_step.py [my_recording]
"""

import sys
from pathlib import Path

import numpy as np

import swardmap
from swardmap import Config, Frame, MapClass, ObstacleMapper, Segmentation, open_source
from swardmap.labels import GRASS_OBSTACLE

DEMO = Path(swardmap.__file__).parent / "data" / "demo"


class GreenIsGrass:
    """The shortest segmenter: any callable that gives a Segmentation, with a name and a label set."""

    name = "green is grass"
    label_set = GRASS_OBSTACLE

    def __call__(self, frame: Frame) -> Segmentation:
        red, green, blue = np.moveaxis(frame.rgb.astype(np.int16), -1, 0)
        grass = 2 * green - red - blue > 20
        return Segmentation(np.where(grass, 1, 0).astype(np.uint8), self.label_set)


def main(recording: str | Path = DEMO) -> None:
    mapper = ObstacleMapper(GreenIsGrass(), Config())
    for step in mapper.run(open_source(recording)):
        nearest = np.count_nonzero(step.seen.is_obstacle)
        print(f"frame {step.frame.name}: {nearest} obstacle cells, {step.counts.inconsistent} flying pixels")
    grid, costmap = mapper.map, mapper.costmap()
    if grid is not None and costmap is not None:
        print(f"map {grid.spec.shape}: {grid.count(MapClass.GRASS)} cells may be mown")
        print(f"costmap: {np.count_nonzero(costmap.costs == 254)} lethal cells")


if __name__ == "__main__":
    main(*sys.argv[1:2])
