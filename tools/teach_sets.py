r"""Make what `swardmap teach` keeps in the package, src/swardmap/data/teach: gardens with exact labels.

    python tools/teach_sets.py replay ROOT/gardens/train-*            # of tools/train_lawn_robots.sh
    python tools/teach_sets.py safety ROOT/gardens/dev ROOT/gardens/train-* GARDENS/*   # and of these:

    for light in clear:5000 cloudy:5001 overcast:5002 sunset:5003 twilight:5004; do
      swardmap synth GARDENS/${light%:*} --scenes 2 --frames 5 --seed ${light#*:} \
        --illumination ${light%:*} --samples 2 --set rig.rate_hz=1
    done

    python tools/teach_sets.py fresh FRESH/*                          # and of these:

    for light in clear:6100 cloudy:6101 overcast:6102 sunset:6103 twilight:6104; do
      swardmap synth FRESH/${light%:*} --scenes 4 --frames 3 --seed ${light#*:} --illumination ${light%:*} \
        --samples 2 --no-sensor --set map.enabled=false --set rig.rate_hz=0.5
    done

`replay` is learnt from beside the owner's drive, so that nothing is forgotten: gardens that the network in
the package learnt from. `fresh` is learnt from by none: the bias of a taught network is set by it. `safety`
is never learnt from: the gate measures the old and the new network on it.
Of the gardens in train-* it holds the views of the test body, and `replay` none of these gardens.
"""

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from swardmap.config import Config, SourceConfig
from swardmap.eval.things import LOWEST_M, NEAR_M
from swardmap.io import open_source
from swardmap.io.files import table_text
from swardmap.io.sources.truth import FIRST_AREA, IMAGES, TABLE, read_things
from swardmap.labels import GRASS
from swardmap.types import Frame

REPLAYED, REPLAY_WIDTH, SAFETY_WIDTH = 120, 384, 512
QUALITY = 86
BODY_PIXELS = 60


def sequences_of(folder: Path) -> list[Path]:
    """Every drive in one light."""
    return sorted(p for p in (folder / "folder").glob("*/*") if p.is_dir())


def body_pixels(sequence: Path, frame: str) -> int:
    """How much of a test body a frame shows within NEAR_M."""
    keys = [key for key, thing in read_things(sequence / TABLE).items() if thing.kind == "test body"]
    if not keys:
        return 0
    ids, depth = (cv2.imread(str(sequence / part / f"{frame}.png"), -1) for part in (IMAGES, "depth"))
    return int((np.isin(ids, keys) & (depth > 0) & (depth < 1000 * NEAR_M)).sum())


def shows_body(sequence: Path) -> bool:
    """Whether any frame of it shows a test body."""
    return any(body_pixels(sequence, p.stem) >= BODY_PIXELS for p in sorted((sequence / IMAGES).iterdir()))


def take_replay(folders: Sequence[Path], out: Path) -> None:
    """Frames of filmed gardens at even distances, made smaller."""
    for folder in folders:
        every = max(1, (open_source(folder).frame_count or 1) * len(folders) // REPLAYED)
        unwanted = {f"{p.parent.name}-{p.name}" for p in sequences_of(folder) if shows_body(p)}
        for k, frame in enumerate(open_source(folder, Config(source=SourceConfig(every=every)))):
            if frame.name.rpartition("-")[0] not in unwanted:
                write_pair(out, f"{folder.name}-{k:03d}", frame, REPLAY_WIDTH)


def take_fresh(folders: Sequence[Path], out: Path) -> None:
    """All frames of filmed gardens, made smaller."""
    for folder in folders:
        for k, frame in enumerate(open_source(folder)):
            write_pair(out, f"{folder.name}-{k:03d}", frame, REPLAY_WIDTH)


def take_safety(folders: Sequence[Path], out: Path) -> None:
    """All frames of filmed gardens, made smaller, with what stands in each."""
    (out / IMAGES).mkdir()
    told: dict[str, Any] = {}
    for number, folder in enumerate(folders):
        learnt = folder.name.startswith("train-")
        for sequence in (p for p in sequences_of(folder) if not learnt or shows_body(p)):
            scene, light = sequence.parent.name, sequence.name
            for frame in open_source(sequence):
                if learnt and body_pixels(sequence, frame.name) < BODY_PIXELS:
                    continue
                name = f"{number:02d}{scene[-2:]}_{light}_{frame.name}"
                write_pair(out, name, frame, SAFETY_WIDTH)
                told[name] = write_things(sequence, frame, out / IMAGES / f"{name}.png")
    (out / "things.json").write_text(table_text(dict(sorted(told.items()))))


def write_pair(out: Path, name: str, frame: Frame, width: int) -> None:
    """A photo and its mask."""
    labels = np.asarray(frame.labels)
    size = (width, round(width * labels.shape[0] / labels.shape[1]))
    bgr = cv2.resize(cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR), size, interpolation=cv2.INTER_AREA)
    small = cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST)
    cv2.imwrite(str(out / "images" / f"{name}.jpg"), bgr, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    cv2.imwrite(str(out / "labels" / f"{name}.png"), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def write_things(sequence: Path, frame: Frame, file: Path) -> dict[str, Any]:
    """Which thing each pixel is, as far as things are judged: near, and 5 cm high, or bare ground."""
    ids = cv2.imread(str(sequence / IMAGES / f"{frame.name}.png"), cv2.IMREAD_UNCHANGED)
    ids[~(frame.depth_m <= NEAR_M)] = 0
    known, labels = read_things(sequence / TABLE), np.asarray(frame.labels)
    judged = {}
    for key in np.unique(ids[ids > 0]).tolist():
        thing = known[key]
        lawn = float((labels[ids == key] == GRASS.id).mean())  # daisies are lawn
        if lawn < 0.5 and (key >= FIRST_AREA or thing.height_m >= LOWEST_M):
            judged[str(key)] = [thing.kind, round(thing.height_m, 3)]
    ids[~np.isin(ids, [int(k) for k in judged])] = 0
    size = (SAFETY_WIDTH, round(SAFETY_WIDTH * ids.shape[0] / ids.shape[1]))
    small = cv2.resize(ids, size, interpolation=cv2.INTER_NEAREST)
    cv2.imwrite(str(file), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return dict(sorted(judged.items()))


def main() -> None:
    """Make the set that is named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("set", choices=("safety", "replay", "fresh"))
    parser.add_argument("gardens", nargs="+", type=Path, help="folders of `swardmap synth`")
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "src/swardmap/data/teach")
    chosen = parser.parse_args()
    out = chosen.out / chosen.set
    shutil.rmtree(out, ignore_errors=True)
    for part in ("images", "labels"):
        (out / part).mkdir(parents=True)
    take = {"safety": take_safety, "replay": take_replay, "fresh": take_fresh}[chosen.set]
    take(chosen.gardens, out)
    size_mb = sum(file.stat().st_size for file in out.rglob("*") if file.is_file()) / 1e6
    print(f"{len(list((out / 'images').iterdir()))} frames, {size_mb:.2f} MB in {out}")


if __name__ == "__main__":
    main()
