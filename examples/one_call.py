"""Depth 1 of the API: a whole recording in one call.

python examples/one_call.py my_recording my_map
"""

import sys

from swardmap.config import config_from_dict
from swardmap.runs.recording import map_recording


def main(recording: str, out: str) -> None:
    config = config_from_dict({"grid": {"resolution_m": 0.1}, "costmap": {"margin_m": 0.38}})
    run = map_recording(recording, out, config)
    if run.grid is not None:
        print(f"{run.totals.frames} frames, {run.grid.is_obstacle.sum()} obstacle cells, see {out}")


if __name__ == "__main__":
    main(*sys.argv[1:3])
