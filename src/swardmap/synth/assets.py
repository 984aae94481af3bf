"""Ready-made models, textures and arrays for gardens, read lazily from the bundles of a data package."""

import hashlib
import importlib.util
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError, MissingExtraError
from swardmap.io.door import reading
from swardmap.io.images import decode
from swardmap.synth.asset_bundle import (
    AGAIN,
    Bundle,
    arrays_of,
    open_bundle,
    unpacked_normals,
    unquantised,
)
from swardmap.synth.asset_entries import ModelEntry, Source, TextureEntry, model_entry_of, texture_entry_of
from swardmap.synth.model import Material, Mesh, Model, Texture

VARIABLE = "SWARDMAP_GARDEN_ASSETS"
MODULE = "swardmap_garden_assets"
INSTALL = (
    "Install the garden assets: pip install the wheel swardmap_garden_assets that lies beside swardmap's in "
    "each release, or, in a checkout, ./garden_assets (or name the folder of the bundles in the environment "
    f"variable {VARIABLE})"
)
MAX_TEXTURE_PIXELS = 2048 * 2048

Arrays = Mapping[str, NDArray[Any]]
T = TypeVar("T")


class Assets:
    """All bundles of a folder. Opening reads their indices; the rest is read when asked for, and kept.

    Attributes:
        digest: SHA-256 over the indices, which hold the SHA-256 of every asset.
    """

    def __init__(self, folder: Path, bundles: Iterable[Bundle]) -> None:
        """Use `open_assets`."""
        self._folder = folder
        self._bundles: dict[tuple[str, str], Bundle] = {}
        self._models: dict[str, ModelEntry] = {}
        self._textures: dict[str, TextureEntry] = {}
        self._arrays: dict[str, Source] = {}
        self._kept: dict[tuple[str, str], Any] = {}
        digest = hashlib.sha256()
        for bundle in bundles:
            digest.update(bundle.digest)
            for name, entry in bundle.index["models"].items():
                self._own("models", name, bundle)
                self._models[name] = model_entry_of(name, entry)
            for name, entry in bundle.index["textures"].items():
                self._own("textures", name, bundle)
                self._textures[name] = texture_entry_of(name, entry)
            for name, entry in bundle.index["arrays"].items():
                self._own("arrays", name, bundle)
                self._arrays[name] = Source(**entry["source"])
        self.digest: str = digest.hexdigest()

    def kinds(self) -> tuple[str, ...]:
        """Kinds of the models, sorted."""
        return tuple(sorted({entry.kind for entry in self._models.values()}))

    def names(self, kind: str | None = None) -> tuple[str, ...]:
        """Names of the models, all or of one kind, sorted."""
        return tuple(sorted(name for name, entry in self._models.items() if kind in (None, entry.kind)))

    def entry(self, name: str) -> ModelEntry:
        """What the index says of a model."""
        return self._known(self._models, name, "model")

    def model(self, name: str) -> Model:
        """The shape of a model; read on the first call.

        Raises:
            InputError: if there is none of that name, or the bundle is damaged.
        """
        entry = self.entry(name)
        return self._once("models", name, lambda bundle: self._model(bundle, entry))

    def texture_names(self, kind: str | None = None) -> tuple[str, ...]:
        """Names of the textures, all or of one kind, sorted."""
        return tuple(sorted(name for name, entry in self._textures.items() if kind in (None, entry.kind)))

    def texture_entry(self, name: str) -> TextureEntry:
        """What the index says of a texture."""
        return self._known(self._textures, name, "texture")

    def texture(self, name: str) -> Texture:
        """A texture; read on the first call, and one object however many models share it.

        Raises:
            InputError: if there is none of that name, or the bundle is damaged.
        """
        self.texture_entry(name)
        return self._once("textures", name, lambda bundle: _texture_of(bundle, name))

    def array_names(self) -> tuple[str, ...]:
        """Names of the sets of arrays, sorted."""
        return tuple(sorted(self._arrays))

    def arrays(self, name: str) -> Arrays:
        """A set of arrays by name, read-only; read on the first call.

        Raises:
            InputError: if there is none of that name, or the bundle is damaged.
        """
        self._known(self._arrays, name, "set of arrays")
        return self._once("arrays", name, lambda bundle: _read_only(arrays_of(bundle, "arrays", name)))

    def attribution(self) -> str:
        """Title, author, licence and package of every asset, one a line, as Markdown."""
        sources = {
            **{f"model {name}": entry.source for name, entry in self._models.items()},
            **{f"texture {name}": entry.source for name, entry in self._textures.items()},
            **{f"arrays {name}": source for name, source in self._arrays.items()},
        }
        return "".join(f"- {what}: {source}\n" for what, source in sorted(sources.items()))

    def _own(self, part: str, name: str, bundle: Bundle) -> None:
        if (part, name) in self._bundles:
            raise ValueError(f"{name} is in {self._bundles[part, name].path.name} and in {bundle.path.name}")
        self._bundles[part, name] = bundle

    def _known(self, entries: Mapping[str, T], name: str, what: str) -> T:
        if name not in entries:
            some = ", ".join(sorted(entries)[:5])
            raise InputError(f"expected the name of a {what} in {self._folder} ({some}, ...), got '{name}'")
        return entries[name]

    def _once(self, part: str, name: str, read: Callable[[Bundle], T]) -> T:
        if (part, name) not in self._kept:
            bundle = self._bundles[part, name]
            with reading(f"{bundle.path}: {part}/{name}", "a whole asset", more=AGAIN):
                self._kept[part, name] = read(bundle)
        kept: T = self._kept[part, name]
        return kept

    def _model(self, bundle: Bundle, entry: ModelEntry) -> Model:
        arrays = arrays_of(bundle, "models", entry.name)
        indices = bundle.index["models"][entry.name]["meshes"]
        return Model(entry.name, tuple(self._mesh(arrays, k, entry, mesh) for k, mesh in enumerate(indices)))

    def _mesh(self, arrays: Arrays, k: int, entry: ModelEntry, index: Mapping[str, Any]) -> Mesh:
        return Mesh(
            unquantised(arrays[f"{k}.xyz"], entry.low_m, entry.high_m),
            unpacked_normals(arrays[f"{k}.normals"]),
            unquantised(arrays[f"{k}.uv"], index["uv_low"], index["uv_high"]),
            np.cumsum(arrays[f"{k}.faces"], dtype=np.int64).astype(np.uint32).reshape(-1, 3),
            self._material(index["material"]),
        )

    def _material(self, index: Mapping[str, Any]) -> Material:
        r, g, b = (float(value) for value in index["color"])
        return Material(
            (r, g, b),
            self.texture(index["texture"]) if index["texture"] else None,
            bool(index["cutout"]),
            float(index["translucency"]),
            float(index["specular"]),
            float(index["roughness"]),
        )


def open_assets(folder: str | Path | None = None) -> Assets:
    """Open the bundles of garden assets.

    Args:
        folder: of the bundles. Default: the environment variable SWARDMAP_GARDEN_ASSETS, else the installed
            package swardmap-garden-assets, else the folder `garden_assets` of a source checkout.

    Raises:
        MissingExtraError: if there are none, with the command that installs them.
        InputError: if a bundle is damaged, or no bundle.
    """
    place = Path(folder) if folder is not None else _find()
    paths = sorted(place.glob("*.zip")) if place.is_dir() else []
    if not paths:
        raise MissingExtraError(f"{place}: expected a folder with bundles (*.zip), found none. {INSTALL}")
    return assets_of(place, [open_bundle(path) for path in paths])


def assets_of(place: Path, bundles: Iterable[Bundle]) -> Assets:
    """The assets of bundles.

    Raises:
        InputError: if their indices are damaged or do not fit together.
    """
    with reading(place, "bundles that fit together", more=AGAIN):
        return Assets(place, bundles)


def _find() -> Path:
    """Folder of the bundles, by the rules of `open_assets`."""
    if named := os.environ.get(VARIABLE):
        return Path(named)
    spec = importlib.util.find_spec(MODULE)
    if spec is not None and spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations)))
    checkout = Path(__file__).parents[3] / "garden_assets" / MODULE
    if checkout.is_dir():
        return checkout
    raise MissingExtraError(f"The garden assets are not installed. {INSTALL}")


def _texture_of(bundle: Bundle, name: str) -> Texture:
    image = decode(bundle.read("textures", name), f"{bundle.path}: textures/{name}")
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[0] * image.shape[1] > MAX_TEXTURE_PIXELS:
        raise ValueError(f"expected 8-bit colours, at most {MAX_TEXTURE_PIXELS} pixels, got {image.shape}")
    rgba = np.full((*image.shape[:2], 4), 255, np.uint8)
    rgba[..., :3] = image[..., 2::-1]
    if image.shape[2] == 4:
        rgba[..., 3] = image[..., 3]
    return Texture(name, rgba)


def _read_only(arrays: dict[str, NDArray[Any]]) -> Arrays:
    for array in arrays.values():
        array.flags.writeable = False
    return MappingProxyType(arrays)
