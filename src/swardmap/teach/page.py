"""The page to look at before anything is learnt: labels over frames and on the map, what is doubtful."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import MountConfig
from swardmap.labels import GRASS, GRASS_OBSTACLE_PERSON, OTHER, PERSON, VOID_ID, MapClass
from swardmap.teach.doubt import Doubt
from swardmap.teach.drive import Drive, raised_cells
from swardmap.teach.labels import DrivenGround
from swardmap.teach.write import Shown, Written
from swardmap.viz.map_layers import image_url
from swardmap.viz.templates import render

Picture = NDArray[np.uint8]

PAPER, FLAT = (244, 245, 242), (206, 210, 205)
DOUBTFUL, NOTHING, WAY = (240, 150, 30), (150, 110, 170), (211, 47, 160)
KEYS = (
    ("drivable: learnt as grass", GRASS.color),
    ("driven, but doubtful: not learnt", DOUBTFUL),
    ("left out", NOTHING),
    ("stands: learnt as other", OTHER.color),
    ("flat, not driven", FLAT),
    ("way of the robot", WAY),
)
MAP_EDGE = 1100
MARGIN_PX = 40
FRAME_WIDTH = 400
STRONG, PALE = 0.55, 0.32


@dataclass(frozen=True, slots=True, eq=False)
class JudgedDrive:
    """A drive with all that was made of it."""

    drive: Drive
    doubt: Doubt
    ground: DrivenGround


def teach_page(judged: Sequence[JudgedDrive], written: Written, command: str) -> str:
    """The whole page, one HTML file.

    Args:
        judged: each drive.
        written: labels of all of them.
        command: that goes on from here.
    """
    names = ", ".join(j.drive.name for j in judged)
    return render(
        "teach.html",
        title=f"What {names} teaches",
        subtitle=f"{written.learn} frames to learn from, {written.held} to measure on",
        warnings=warnings(judged, written),
        cards=cards(judged, written),
        command=command,
        maps=[_map_view(j) for j in judged],
        keys=[(name, _css(color)) for name, color in KEYS],
        classes=[(c.name, _css(c.color)) for c in (GRASS, OTHER, PERSON)],
        frames=[_frame_view(s) for s in written.shown],
        left_out=[
            (j.drive.name, reason, ", ".join(f"{a:g}-{b:g}" for a, b in spans))
            for j in judged
            for reason, spans in j.drive.left_out.items()
        ],
    )


def mount_warning(mount: MountConfig) -> list[str]:
    """What a person should read where nobody said where the camera sits on the robot."""
    if mount.x_m or mount.y_m:
        return []
    line = (
        "The footprint is laid under the camera: give mount.x_m, metres that it is ahead of the middle of "
        "the robot, or ground beyond the end of each lane is learnt as driven."
    )
    return [line]


def warnings(judged: Sequence[JudgedDrive], written: Written) -> list[str]:
    """What a person should look at, in a line each."""
    lines = []
    for j in judged:
        area_m2 = float(j.doubt.cells.sum()) * j.drive.spec.resolution_m**2
        if area_m2 > 0:
            lines.append(
                f"{j.drive.name}: {area_m2:.1f} m² of the driven ground do not look like the rest (orange on "
                "the map): a path or a terrace? They are not learnt from."
            )
        wrong = {k: v for k, v in j.drive.left_out.items() if "told" not in k}
        lines += [f"{j.drive.name}: {len(v)} time spans are left out: {k}." for k, v in wrong.items()]
        share = j.doubt.grass_share
        if share is not None and share < 0.5:
            lines.append(
                f"{j.drive.name}: the network so far calls only {share:.0%} of the driven ground grass. If "
                "that is lawn, this is what teaching is for; if it is paving, do not go on."
            )
        if not np.isfinite(j.ground.least_other):
            lines.append(
                f"{j.drive.name}: the network so far takes some driven ground for no lawn, so its word about "
                "flat ground is not learnt: a path in view may become lawn. Compare maps by both networks "
                "before you trust the new one, and give the robot a work area."
            )
    if written.held and not written.held_driven:
        lines.append(
            "The last part of the drive, which is kept to measure on, shows no ground that was driven: "
            "whether the new network knows the lawn better will not be measured. Drive in lanes."
        )
    total = sum(written.pixels[n] for n in ("grass", "other", "person"))
    if total and written.pixels["other"] < 0.02 * total:
        lines.append(
            "Hardly anything stands in these views: only the gardens in the package tell what is no lawn."
        )
    return lines


def cards(judged: Sequence[JudgedDrive], written: Written) -> list[tuple[str, str, str]]:
    """Figure, what it is, and more about it."""
    driven_m2 = sum(j.drive.driven_m2 for j in judged)
    driven = sum(written.driven.values())
    known = written.driven["grass"] / driven if driven else None
    raised = written.pixels["other"] + written.pixels["person"]
    return [
        (f"{driven_m2:.0f} m²", "driven over", f"{sum(len(j.drive.used) for j in judged)} frames used"),
        ("-" if known is None else f"{known:.0%}", "called grass now", "of the driven ground's pixels"),
        (f"{written.raised_called_grass / max(1, raised):.1%}", "called grass now", "of what stands"),
    ]


def _map_view(judged: JudgedDrive) -> dict[str, Any]:
    picture = draw_map(judged)
    return {
        "url": image_url(picture, ".png"),
        "width": picture.shape[1],
        "height": picture.shape[0],
        "name": judged.drive.name,
    }


def draw_map(judged: JudgedDrive) -> Picture:
    """(H, W, 3) what each cell is labelled as, y up, with the way of the robot."""
    import cv2

    drive, spec = judged.drive, judged.drive.spec
    cells = np.full((*spec.shape, 3), PAPER, np.uint8)
    for p in drive.used:
        x, y = p.seen.spec.offset_in(spec)
        part = cells[y : y + p.seen.spec.height, x : x + p.seen.spec.width]
        part[p.seen.flat] = FLAT
    cells[raised_cells(drive)] = OTHER.color
    cells[judged.ground.driven] = GRASS.color
    cells[(drive.driven > 0) & judged.ground.nothing] = NOTHING
    cells[judged.doubt.cells] = DOUBTFUL
    scale = max(1, MAP_EDGE // max(spec.shape))
    size = (spec.width * scale, spec.height * scale)
    picture = np.ascontiguousarray(cv2.resize(cells[::-1], size, interpolation=cv2.INTER_NEAREST))
    way = (drive.track.xy_m - np.asarray(spec.origin_m)) / spec.resolution_m * scale
    way[:, 1] = size[1] - way[:, 1]
    for i in np.flatnonzero(drive.kept[:-1] & drive.kept[1:]).tolist():
        a, b = (tuple(np.round(way[k]).astype(int).tolist()) for k in (i, i + 1))
        cv2.line(picture, a, b, WAY, 2, cv2.LINE_AA)
    return _without_margin(picture, MARGIN_PX)


def _without_margin(picture: Picture, kept_px: int) -> Picture:
    """The part that shows something, with so much paper around it as there is, at most."""
    shown = (picture != PAPER).any(2)
    if not shown.any():
        return picture
    rows, columns = (np.flatnonzero(shown.any(axis)) for axis in (1, 0))
    first_y, first_x = max(0, rows[0] - kept_px), max(0, columns[0] - kept_px)
    return np.ascontiguousarray(
        picture[first_y : rows[-1] + 1 + kept_px, first_x : columns[-1] + 1 + kept_px]
    )


def _frame_view(shown: Shown) -> dict[str, Any]:
    labels = overlaid(shown.rgb, shown.labels.said, PALE)
    strong = overlaid(shown.rgb, shown.labels.sure, STRONG)
    known = shown.labels.sure != VOID_ID
    labels[known] = strong[known]
    table = shown.before.label_set.map_class_table
    ids = np.array([VOID_ID, GRASS.id, OTHER.id, PERSON.id], np.uint8)[table[shown.before.labels]]
    return {
        "name": shown.name,
        "seconds": shown.seconds,
        "held": shown.held,
        "labels": _small(labels),
        "before": _small(overlaid(shown.rgb, ids, STRONG)),
        "wrong": wrong_text(shown),
    }


def wrong_text(shown: Shown) -> str:
    """How much of what the drive knows the network so far calls something else."""
    classes = shown.before.map_classes
    grass = shown.labels.sure == GRASS.id
    raised = (shown.labels.sure == OTHER.id) | (shown.labels.sure == PERSON.id)
    parts = []
    if grass.any():
        parts.append(
            f"{(classes[grass] != MapClass.GRASS).mean():.0%} of the driven ground is no grass to it"
        )
    if raised.any():
        parts.append(f"{(classes[raised] == MapClass.GRASS).mean():.0%} of what stands is grass to it")
    return "; ".join(parts) or "the drive says nothing here"


def overlaid(rgb: Picture, labels: NDArray[np.uint8], opacity: float) -> Picture:
    """(H, W, 3) the frame with its labels over it; void is left as it is."""
    colors = GRASS_OBSTACLE_PERSON.color_table[labels]
    mixed = rgb * (1 - opacity) + colors * opacity
    return np.where((labels == VOID_ID)[..., None], rgb, mixed).astype(np.uint8)


def _small(picture: Picture) -> str:
    import cv2

    height = round(picture.shape[0] * FRAME_WIDTH / picture.shape[1])
    small = cv2.resize(picture, (FRAME_WIDTH, height), interpolation=cv2.INTER_AREA)
    return image_url(np.asarray(small, np.uint8), ".jpg", 78)


def _css(color: Sequence[int]) -> str:
    return "#" + "".join(f"{int(c):02x}" for c in color)
