"""Depth 1 of the API: a whole recording in one call.

python examples/one_call.py [my_recording [my_map]]
"""

import sys
from pathlib import Path

import swardmap
from swardmap.config import config_from_dict

DEMO = Path(swardmap.__file__).parent / "data" / "demo"


def main(recording: str | Path = DEMO, out: str = "out") -> None:
    config = config_from_dict({"grid": {"resolution_m": 0.1}, "costmap": {"margin_m": 0.38}})
    run = swardmap.map_recording(recording, out, config, overwrite=True)
    if run.grid is not None:
        print(
            f"{run.totals.frames} frames, {run.grid.is_obstacle.sum()} obstacle cells, see {out}/report.html"
        )


if __name__ == "__main__":
    main(*sys.argv[1:3])
