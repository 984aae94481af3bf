"""Readers of what swardmap or others saved: state, evaluations, assets, networks. Checksums are put aside.

Damage seldom passes a checksum, so with them on nothing behind them is ever tried. An attacker can make them
right; so here they always are.
"""

import json
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from swardmap.config import Config, config_from_dict
from swardmap.io.door import reading
from swardmap.io.maps.log_odds_files import read_living_map
from swardmap.labels import GRASS_OBSTACLE_PERSON
from swardmap.synth.shapes import sphere

Read = Callable[[Path], Any]


class _AnyDigest(str):
    """Equal to every checksum."""

    __slots__ = ()
    __hash__ = str.__hash__

    def __eq__(self, _: object) -> bool:
        return True

    def __ne__(self, _: object) -> bool:
        return False


class _AnySum:
    @staticmethod
    def hexdigest() -> str:
        return _AnyDigest("any")

    @staticmethod
    def digest() -> bytes:
        return b"any"


@contextmanager
def sums_right() -> Iterator[None]:
    """Checksums of zip members and of assets hold inside, whatever the bytes."""
    with (
        mock.patch.object(zipfile.ZipExtFile, "_update_crc", return_value=None),
        mock.patch("swardmap.synth.asset_bundle.hashlib.sha256", return_value=_AnySum()),
    ):
        yield


def _right(read: Read) -> Read:
    def with_sums(path: Path) -> Any:
        with sums_right():
            return read(path)

    return with_sums


def stored(archive: Path) -> bytes:
    """The same zip archive with nothing packed, so that damage meets arrays and not a compressor."""
    plain = archive.with_suffix(".stored")
    with zipfile.ZipFile(archive) as old, zipfile.ZipFile(plain, "w", zipfile.ZIP_STORED) as new:
        for name in old.namelist():
            new.writestr(zipfile.ZipInfo(name), old.read(name))
    return plain.read_bytes()


def living_map(file: Path, config: Config) -> tuple[Read, tuple[bytes, ...]]:
    """A saved living map with content, packed and not, that is read into settings like its own and others."""
    other = config_from_dict({"grid": {"mode": "log_odds", "resolution_m": 0.2}, "evidence": {"window_m": 8}})

    def read(path: Path) -> Any:
        return read_living_map(path, config), read_living_map(path, other)

    return _right(read), (file.read_bytes(), stored(file))


def assets(corpus: Path) -> tuple[Read, tuple[bytes, ...]]:
    """A bundle with a model, its texture and an array, all of which are read."""
    from swardmap.synth.asset_bundle import open_bundle
    from swardmap.synth.asset_entries import Source
    from swardmap.synth.assets import assets_of
    from swardmap.synth.model import Material, Texture
    from tools.bake_assets.bundle import BundleWriter

    rgba = np.random.default_rng(0).integers(0, 255, (8, 8, 4), np.uint8)
    source, bundle = Source("thing", "somebody", "CC0-1.0", "package 1"), BundleWriter()
    bundle.add_texture("skin", rgba, "skin", source)
    bundle.add_model(
        "ball", [sphere(0.5, material=Material((1, 1, 1), Texture("skin", rgba)))], "ball", source
    )
    bundle.add_arrays("numbers", {"x": np.arange(6.0).reshape(2, 3)}, source)
    bundle.write(corpus / "small.zip")

    def read(path: Path) -> Any:
        found = assets_of(path.parent, [open_bundle(path)])
        models = [found.model(name) for name in found.names()]
        return models, [found.arrays(name) for name in found.array_names()]

    return _right(read), ((corpus / "small.zip").read_bytes(), stored(corpus / "small.zip"))


def evaluation(folder: Path) -> list[str]:
    """Evaluate two small frames into a folder; its plan and its only part."""
    from swardmap.eval.dataset import DatasetSpec
    from swardmap.eval.run import evaluate, make_plan

    plan = make_plan(
        DatasetSpec("analytic:scenes=1,frames=2,width=64"),
        config_from_dict({"segmenter": {"name": "colour"}}),
        resolutions_m=(0.2,), protocols=("dense",), with_budget=False,
    )  # fmt: skip
    evaluate(plan, folder, workers=1)
    return ["plan.json", next((folder / "parts").iterdir()).relative_to(folder).as_posix()]


def read_evaluation(file: Path) -> Any:
    """What is told of an evaluation, one of whose files is given."""
    from swardmap.eval.results import results
    from swardmap.eval.run import read_plan, read_records

    folder = _folder_of(file)
    plan, total = read_plan(folder)
    records = read_records(folder, min(total, 1000))
    with reading(folder, "whole records of an evaluation"):
        return results(plan, records)


def compare(file: Path) -> Any:
    """The evaluation against itself."""
    from swardmap.eval.compare import compare_runs

    with mock.patch("swardmap.eval.compare.DRAWS", 20):
        return compare_runs([_folder_of(file)] * 2)


def _folder_of(file: Path) -> Path:
    return file.parent if file.name == "plan.json" else file.parent.parent


def network_metadata() -> tuple[Read, tuple[bytes, ...]]:
    """The text beside the weights of an ONNX file."""
    from swardmap.models.spec import NetworkSpec

    spec = NetworkSpec(
        name="small", width=64, height=48, channel_ids=(0, 1, 2), label_set=GRASS_OBSTACLE_PERSON,
        mean=(0.5, 0.5, 0.5), std=(0.2, 0.2, 0.2),
    )  # fmt: skip

    def read(path: Path) -> Any:
        return NetworkSpec.from_json(path.read_bytes().decode("utf-8", "surrogateescape"), str(path))

    return read, (spec.to_json().encode(), json.dumps(json.loads(spec.to_json()), indent=1).encode())


def checkpoint(corpus: Path) -> tuple[Read, tuple[bytes, ...]]:
    """A checkpoint of training, without the weights of a network; needs torch."""
    import torch

    from swardmap.train.checkpoint import CHECKPOINT_VERSION, read_checkpoint
    from swardmap.train.recipe import DataConfig, Recipe, recipe_from_dict, recipe_to_dict

    tree = {
        "version": CHECKPOINT_VERSION,
        "recipe": recipe_to_dict(Recipe("small", data=(DataConfig("photos"),))),
        "average": {"a.weight": torch.ones(2, 3), "a.bias": torch.zeros(2)},
        "step": 7,
    }
    torch.save(tree, corpus / "last.pt")

    def read(path: Path) -> Any:
        state = read_checkpoint(path)
        with reading(path, "a whole checkpoint"):  # as `load_network` does
            state["recipe"]
        return recipe_from_dict(state["recipe"], str(path))

    return read, ((corpus / "last.pt").read_bytes(),)
