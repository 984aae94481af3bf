"""Contact sheets of gardens, to look at: lights.jpg, truth.jpg and people.jpg.

python -m tools.garden_gallery docs/gallery [lights] [truth] [people]

The scenes are chosen by hand, as (seed, frame of a run of 60 at 5 Hz).
"""

import sys
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.io.sources.eden_layout import LIGHTS
from swardmap.synth.assets import open_assets
from swardmap.synth.config import SynthConfig, load_synth_config
from swardmap.synth.model import Model
from swardmap.synth.people import POSES
from swardmap.synth.people.figure import figure_of
from swardmap.synth.people.riding import bicycles, fit_of, rider
from swardmap.synth.sensor.camera import draw_faults, photograph
from swardmap.synth.sensor.stereo import draw_stereo, stereo_depth
from swardmap.synth.stage import GardenStage
from tools.bake_people.sheet import sheet, somebody

Picture = NDArray[np.uint8]

IN_LIGHTS = ((1, 8), (8, 8), (10, 8), (17, 8), (21, 40), (23, 40))
IN_TRUTH = ((22, 8, "clear"), (20, 40, "cloudy"), (5, 40, "overcast"), (16, 8, "clear"), (11, 40, "sunset"))
OVERLAY = {0: (60, 120, 255), 2: (255, 40, 40)}  # other and person; grass stays as it is
NEAR_M, FAR_M, QUALITY = 0.5, 12.0, 82


@cache
def stage() -> GardenStage:
    """Frames of 512 x 384."""
    return GardenStage(config())


@cache
def config() -> SynthConfig:
    """A camera with its noise, without dirt on it."""
    return load_synth_config(
        None, ["rig.width=512", "rig.height=384", "camera.dirt=[0,0]", "camera.raindrops=[0,0]"]
    )


def frames(seed: int, frame: int, lights: tuple[str, ...]) -> list[tuple[Picture, Picture, Picture, Picture]]:
    """Photo, labels over it, exact depth and the sensor's depth of a frame, in each light; RGB."""
    garden = stage().garden(seed)
    lens, run = stage().drive(garden, 60, config().rig)
    stamp_ns, pose = run[frame]
    found = []
    for k, name in enumerate(lights):
        light = stage().light(name, np.random.default_rng([seed, k]))
        view = stage().view(garden, light, lens, pose, stamp_ns)
        rng = np.random.default_rng([seed, frame, k])
        photo = photograph(view.radiance, draw_faults(config().camera, rng), rng)
        grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY)
        sensed = stereo_depth(view.depth_m, grey, lens.fx, draw_stereo(config().stereo, rng), rng)
        labelled = photo.copy()
        for label, color in OVERLAY.items():
            here = view.labels == label
            labelled[here] = (0.45 * photo[here] + 0.55 * np.array(color)).astype(np.uint8)
        found.append((photo, labelled, colored(view.depth_m), colored(sensed * np.float32(0.001))))
    return found


def colored(depth_m: NDArray[np.float32]) -> Picture:
    """Near is yellow, far is violet, on a scale of ratios; black = no reading or sky."""
    share = np.log(np.maximum(depth_m, NEAR_M) / NEAR_M) / np.log(FAR_M / NEAR_M)
    bgr = cv2.applyColorMap((255 * (1 - np.clip(share, 0, 1))).astype(np.uint8), cv2.COLORMAP_PLASMA)
    return np.where((depth_m > 0)[..., None], bgr[..., ::-1], 0).astype(np.uint8)


def grid(rows: list[list[Picture]], size: tuple[int, int]) -> Picture:
    """Tiles of one size with a thin line between them."""
    tiles = [[cv2.resize(tile, size, interpolation=cv2.INTER_AREA) for tile in row] for row in rows]
    lined = [[cv2.copyMakeBorder(t, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=(255, 255, 255)) for t in row]
             for row in tiles]  # fmt: skip
    return np.vstack([np.hstack(row) for row in lined]).astype(np.uint8)


def lights() -> Picture:
    """A row for each garden, a column for each light."""
    return grid([[shot[0] for shot in frames(seed, k, LIGHTS)] for seed, k in IN_LIGHTS], (256, 192))


def truth() -> Picture:
    """Photo, labels, exact and sensor depth."""
    return grid([list(frames(seed, k, (light,))[0]) for seed, k, light in IN_TRUTH], (320, 240))


def people() -> Picture:
    """Eight of each pose, walking, running and riding at the end."""
    poses = (*POSES, "walking", "running")
    models = [
        somebody(open_assets(), pose, [4, k, i], k, 8) for i, pose in enumerate(poses) for k in range(8)
    ]
    for k in range(8):
        rng = np.random.default_rng([4, k, len(poses)])
        figure = figure_of(rng, open_assets())
        fit = fit_of(figure)
        meshes = (*rider(figure, fit, k / 8), *bicycles(rng, fit, 8)[k].meshes)
        models.append(Model("rider", meshes))
    return sheet(models, 16, (100, 130), 25)


def main() -> None:
    """Write the sheets that the command line names, by default all."""
    folder, wanted = Path(sys.argv[1]), sys.argv[2:] or ["lights", "truth", "people"]
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in (("lights", lights), ("truth", truth), ("people", people)):
        if name in wanted:
            path = folder / f"{name}.jpg"
            cv2.imwrite(str(path), make()[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            print(path, path.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
