"""Film the drive that `swardmap demo` maps: src/swardmap/data/demo, about 3 MB, in our folder layout.

    python tools/demo_recording.py

The sensor's depth is kept up to MAX_M only: what is farther is not mapped, and costs most of the bytes.
"""

import argparse
import shutil
from pathlib import Path

import cv2
import numpy as np

from swardmap.io.sources import folder
from swardmap.synth.config import load_synth_config
from swardmap.synth.plan import SynthPlan
from swardmap.synth.produce import make_source
from swardmap.synth.sequence import GardenSource
from swardmap.synth.stage import garden_stage

SEED, SCENE, LIGHT, FRAMES = 0, 9, "clear", 20
SETTINGS = ("rig.width=480", "rig.height=360", "rig.rate_hz=2.0", "camera.jpeg_quality=[0,0]",
            "camera.exposure_ev=[0,0]", "camera.dirt=[0,0]", "camera.raindrops=[0,0]")  # fmt: skip
QUALITY = 84
MAX_M = 7.0


def film(source: GardenSource, out: Path) -> None:
    """Write the drive: colour as JPEG, depth in millimetres, labels, poses."""
    shutil.rmtree(out, ignore_errors=True)
    count = folder.write_folder(source, out)
    (out / ".swardmap").unlink()  # no output that --overwrite may replace
    for file in sorted((out / "rgb").iterdir()):
        cv2.imwrite(str(file.with_suffix(".jpg")), cv2.imread(str(file)), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        file.unlink()
    for file in sorted((out / "depth").iterdir()):
        depth = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        depth[depth > 1000 * MAX_M] = 0
        cv2.imwrite(str(file), depth, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    size = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    seen = [float(np.mean(frame.labels == 2)) for frame in folder.open_source(out, folder.SourceConfig())]
    print(f"{count} frames, {size / 1e6:.2f} MB in {out}; person pixels {min(seen):.3f}-{max(seen):.3f}")


def main() -> None:
    """Film it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "src/swardmap/data/demo")
    parser.add_argument("--scene", type=int, default=SCENE)
    arguments = parser.parse_args()
    config = load_synth_config(None, SETTINGS)
    plan = SynthPlan(SEED, arguments.scene + 1, FRAMES, (LIGHT,), config)
    film(make_source(plan, garden_stage(config), arguments.scene, LIGHT), arguments.out)


if __name__ == "__main__":
    main()
