"""Film the drive that `swardmap demo` maps: src/swardmap/data/demo, about 6 MB, in our folder layout.

    python tools/demo_recording.py

Depth is kept up to MAX_M only: what is farther is not mapped, and costs most of the bytes. Beside the
sensor's depth lie the exact one and which thing each pixel is: the demo is judged by what is truly there.
"""

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from swardmap.io.sources import folder
from swardmap.io.sources.truth import IMAGES, TABLE, KnownThing, write_things
from swardmap.synth.config import load_synth_config
from swardmap.synth.instances import instance_ids, known_things
from swardmap.synth.plan import SynthPlan
from swardmap.synth.produce import make_source
from swardmap.synth.sequence import GardenSource, Shot
from swardmap.synth.stage import garden_stage

SEED, SCENE, LIGHT, FRAMES = 0, 9, "clear", 20
SETTINGS = ("rig.width=480", "rig.height=360", "rig.rate_hz=2.0", "camera.jpeg_quality=[0,0]",
            "camera.exposure_ev=[0,0]", "camera.dirt=[0,0]", "camera.raindrops=[0,0]")  # fmt: skip
QUALITY = 84
MAX_M = 7.0
EXACT_UNIT_M = 0.01  # a finer step costs bytes: at 5 m it moves heights by 2 mm at most


def film(source: GardenSource, out: Path) -> None:
    """Write the drive: colour as JPEG, depth in millimetres, labels, poses, exact depth, ids of things."""
    shutil.rmtree(out, ignore_errors=True)
    shots = list(source.shots())
    count = folder.write_folder((shot.frame for shot in shots), out)
    write_truth(source, shots, out)
    (out / ".swardmap").unlink()  # no output that --overwrite may replace
    for file in sorted((out / "rgb").iterdir()):
        cv2.imwrite(str(file.with_suffix(".jpg")), cv2.imread(str(file)), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        file.unlink()
    for file in sorted([*(out / "depth").iterdir(), *(out / "exact" / "depth").iterdir()]):
        depth = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        depth[depth * (EXACT_UNIT_M if "exact" in file.parts else 0.001) > MAX_M] = 0
        cv2.imwrite(str(file), depth, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    size = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    seen = [float(np.mean(frame.labels == 2)) for frame in folder.open_source(out, folder.SourceConfig())]
    print(f"{count} frames, {size / 1e6:.2f} MB in {out}; person pixels {min(seen):.3f}-{max(seen):.3f}")


def write_truth(source: GardenSource, shots: Sequence[Shot], out: Path) -> None:
    """Exact depth in steps of EXACT_UNIT_M, and which thing each pixel is."""
    things: dict[int, KnownThing] = {}
    for part in ("exact/depth", IMAGES):
        (out / part).mkdir(parents=True)
    for shot in shots:
        frame, ground = shot.frame, source.garden.ground
        exact = np.rint(shot.view.depth_m / EXACT_UNIT_M).astype(np.uint16)
        exact[shot.view.depth_m > MAX_M] = 0
        cv2.imwrite(str(out / "exact/depth" / f"{frame.name}.png"), exact)
        ids = instance_ids(shot.view, ground, frame.intrinsics, frame.T_map_camera)
        things |= known_things(ids, source.garden.at(frame.stamp_ns), ground)
        cv2.imwrite(str(out / IMAGES / f"{frame.name}.png"), ids, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    write_things(out / TABLE, things)
    camera = (out / folder.CAMERA_FILE).read_text()
    exact_camera = camera.replace("depth_unit_m: 0.001", f"depth_unit_m: {EXACT_UNIT_M}")
    (out / "exact" / folder.CAMERA_FILE).write_text(exact_camera)


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
