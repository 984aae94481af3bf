"""Depth 2 of the API: frame by frame, with your own source and your own segmenter.

python examples/step_by_step.py
"""

import numpy as np

from swardmap.config import Config
from swardmap.labels import GRASS_OBSTACLE, MapClass
from swardmap.pipeline import ObstacleMapper
from swardmap.synth.analytic import AnalyticSource, garden_scene, lane_poses
from swardmap.types import Frame, Segmentation


class GreenIsGrass:
    """The shortest segmenter: any callable that gives a Segmentation, with a name and a label set."""

    name = "green is grass"
    label_set = GRASS_OBSTACLE

    def __call__(self, frame: Frame) -> Segmentation:
        red, green, blue = np.moveaxis(frame.rgb.astype(np.int16), -1, 0)
        grass = 2 * green - red - blue > 20
        return Segmentation(np.where(grass, 1, 0).astype(np.uint8), self.label_set)


def main() -> None:
    source = AnalyticSource(garden_scene(seed=3), tuple(lane_poses(5, step_m=0.3)))
    mapper = ObstacleMapper(GreenIsGrass(), Config())
    for step in mapper.run(source):
        nearest = np.count_nonzero(step.seen.is_obstacle)
        print(f"frame {step.frame.name}: {nearest} obstacle cells, {step.counts.inconsistent} flying pixels")
    grid, costmap = mapper.map, mapper.costmap()
    if grid is not None and costmap is not None:
        print(f"map {grid.spec.shape}: {grid.count(MapClass.GRASS)} cells may be mown")
        print(f"costmap: {np.count_nonzero(costmap.costs == 254)} lethal cells")


if __name__ == "__main__":
    main()
