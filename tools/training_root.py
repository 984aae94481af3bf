"""Make the folder that recipes/lawn-robots.yaml learns from: links to photos, lists of what is held out.

    python tools/training_root.py ~/photos ~/training --network lawn-0.1.0.onnx

No photo is copied or changed. `igvc_lawn` is one drive over one lawn: its first and its last part are held
out, so that no frame that is measured was taken within seconds of one that was learnt from.
"""

import argparse
import shutil
from pathlib import Path

SETS = (
    "camvid",
    "cityscapes8",
    "coco128",
    "coco_stuff10",
    "facade_lawns",
    "igvc2018_grounds",
    "lawn_robots2",
    "msrc_v2",
    "photos_misc",
    "robot_lawns",
    "shadow_photos",
    "streets",
)
LEARNT_FRAMES = range(320, 1800)  # of igvc_lawn, by the number in the name; the drive has 90 to 2236


def main() -> None:
    """Make it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("photos", type=Path, help="folder of the photo sets")
    parser.add_argument("root", type=Path, help="data root to make")
    parser.add_argument("--teachers", type=Path, help="folder of the teachers' .onnx files, for --distil")
    parser.add_argument("--network", type=Path, help="the .onnx file that the training begins from")
    arguments = parser.parse_args()
    root: Path = arguments.root
    root.mkdir(parents=True, exist_ok=True)
    for name in SETS:
        link(arguments.photos / name, root / name)
    (root / "igvc_lawn").mkdir(exist_ok=True)
    for part in ("images", "labels"):
        link(arguments.photos / "igvc_lawn" / part, root / "igvc_lawn" / part)
    write_lists(root / "igvc_lawn")
    if arguments.teachers is not None:
        link(arguments.teachers, root / "teachers")
    if arguments.network is not None:
        shutil.copyfile(arguments.network, root / "lawn.onnx")


def link(source: Path, target: Path) -> None:
    """Link a folder, if it is not linked yet."""
    if not source.is_dir():
        raise SystemExit(f"no such folder: {source}")
    if not target.exists():
        target.symlink_to(source.resolve(), target_is_directory=True)


def write_lists(folder: Path) -> None:
    """`train.txt` and `held.txt`, by the time of the frames."""
    stems = sorted(path.stem for path in (folder / "images").iterdir())
    learnt = [stem for stem in stems if int(stem.split("_")[1]) in LEARNT_FRAMES]
    held = [stem for stem in stems if stem not in learnt]
    for name, chosen in (("train.txt", learnt), ("held.txt", held)):
        (folder / name).write_text("\n".join(chosen) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
