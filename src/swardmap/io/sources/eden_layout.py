"""Where EDEN keeps what: roots, scenes, lights and frames, from folder listings alone."""

import re
from dataclasses import dataclass
from pathlib import Path

from swardmap.errors import InputError

RGB, DEPTH, SEGMENTATION, CAMERA = "RGB", "Depth", "Segmentation", "cam_matrix"
MODALITIES = (RGB, DEPTH, SEGMENTATION, CAMERA)
LIGHTS = ("clear", "cloudy", "overcast", "sunset", "twilight")
SCENE = re.compile(r"\d{4}")
LABEL_TABLE = "label_table.yaml"


@dataclass(frozen=True, slots=True)
class EdenEntry:
    """One frame by name."""

    scene: str
    light: str
    stem: str
    stamp_ns: int

    @property
    def name(self) -> str:
        """Unique in the data set."""
        return f"{self.scene}-{self.light}-{self.stem}"

    def file(self, root: Path, modality: str) -> Path:
        """Where a modality of the frame is."""
        endings = {RGB: "_L.png", DEPTH: "_L.mat", SEGMENTATION: "_L_Sem.png", CAMERA: ".mat"}
        return root / modality / self.scene / self.light / (self.stem + endings[modality])


def locate(path: Path) -> tuple[Path, str | None, str | None] | None:
    """Root, scene and light of a path that is the root or ROOT/MODALITY[/SCENE[/LIGHT]]."""
    for full in (path.absolute(), path.resolve()):  # modalities may be links to other disks
        for root in (full, *list(full.parents)[:3]):
            part, scene, light = (*full.relative_to(root).parts, None, None, None)[:3]
            named = part in (None, *MODALITIES) and (scene is None or SCENE.fullmatch(scene))
            if named and light in (None, *LIGHTS) and _is_root(root):
                return root, scene, light
    return None


def _is_root(folder: Path) -> bool:
    try:
        return (folder / RGB).is_dir() and (folder / DEPTH).is_dir() and bool(scenes(folder))
    except (OSError, InputError):  # not ours to read
        return False


def scenes(root: Path) -> list[str]:
    """Scenes by number, those that only one modality has among them."""
    found = {p.name for part in (RGB, DEPTH) for p in _entries(root / part) if SCENE.fullmatch(p.name)}
    return sorted(found)


def stems_of(root: Path, scene: str, light: str) -> list[str]:
    """Frames of a sequence in the order of their numbers, those that lack a file among them."""
    stems: set[str] = set()
    for modality, ending in ((RGB, "_L.png"), (DEPTH, "_L.mat")):
        files = _entries(root / modality / scene / light)
        stems.update(file.name.removesuffix(ending) for file in files if file.name.endswith(ending))
    return sorted(stems, key=lambda stem: (int(stem) if stem.isdecimal() else -1, stem))


def _entries(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir()) if folder.is_dir() else []
    except OSError as error:
        raise InputError(f"cannot list {folder}: {error.strerror or error}") from error
