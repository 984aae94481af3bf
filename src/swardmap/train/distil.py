"""Masks by teachers for photos that nobody labelled.

A pixel gets a class only where the teachers agree: grass and person where each is sure of it, other where
each is sure that it is neither. Everything else stays void. Only networks that swardmap's user names
are teachers; they are run by ONNX Runtime and are not part of the package.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.errors import ConfigError, InputError, ModelError
from swardmap.labels import GRASS, OTHER, PERSON, VOID_ID, Role
from swardmap.models import bundled_network
from swardmap.models.network_io import preprocess
from swardmap.models.spec import METADATA_KEY, NetworkSpec
from swardmap.train.augment import Image
from swardmap.train.recipe import TeacherConfig

SURE, SURE_NOT = 0.7, 0.05
Float32Array = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Opinion:
    """What one teacher says of one photo, all (h, w).

    Attributes:
        grass, person: float32 probabilities; None from a teacher that is not asked about the class.
        doubtful: bool, true where its first choice is a class that says nothing (ground, field).
    """

    grass: Float32Array | None
    person: Float32Array | None
    doubtful: NDArray[np.bool_]


class Teacher:
    """A segmentation network in an .onnx file, with logits as its output.

    A file with swardmap's metadata says itself how it is fed and which channels are grass and person;
    the file `auto` is the network in the package.
    """

    def __init__(self, config: TeacherConfig, root: Path, threads: int = 1) -> None:
        import onnxruntime

        path = bundled_network() if config.file == "auto" else root / config.file
        if path is None or not path.is_file():
            raise InputError(f"no such teacher: {path or 'this package holds no network'}")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 4
        try:
            self._session: Any = onnxruntime.InferenceSession(
                str(path), options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # the runtime's exceptions share no narrower base
            raise ModelError(f"teacher {path}: expected an ONNX network ({str(error)[:120]})") from error
        text = self._session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
        self._spec = None if text is None else NetworkSpec.from_json(text, str(path))
        if text is None and not (config.grass or config.person):
            raise ConfigError(f"teacher {path}: say which of its channels are grass or person; it does not")
        self._config, self._path = config, path
        self._input: str = self._session.get_inputs()[0].name

    def __call__(self, rgb: Image) -> Opinion:
        """What it says of an image (H, W, 3) uint8."""
        if self._spec is not None:
            return self._by_its_metadata(rgb, self._spec)
        config = self._config
        x = cv2.resize(rgb, (config.size, config.size)).astype(np.float32) / 255
        x = ((x - config.mean) / config.std).transpose(2, 0, 1)[None]
        probability = self._probability(np.ascontiguousarray(x, np.float32), 1.0)
        ids = {k: _ids(getattr(config, k)) for k in ("grass", "person", "doubtful")}
        if max(chain(*ids.values()), default=0) >= len(probability):
            raise ConfigError(f"teacher {self._path}: it has {len(probability)} channels, from 0; got {ids}")
        grass, person = (probability[ids[k]].sum(0) if ids[k] else None for k in ("grass", "person"))
        return Opinion(grass, person, np.isin(probability.argmax(0), ids["doubtful"]))

    def _by_its_metadata(self, rgb: Image, spec: NetworkSpec) -> Opinion:
        buffer = np.zeros((1, 3, spec.height, spec.width), np.float32)
        preprocess(rgb, spec, buffer)
        probability = self._probability(buffer, spec.temperature)
        roles = {c.id: c.role for c in spec.label_set.classes}
        grass, person = (
            probability[[roles[i] is role for i in spec.channel_ids]] for role in (Role.FREE, Role.PERSON)
        )
        doubtful = np.zeros(probability.shape[1:], np.bool_)
        return Opinion(grass.sum(0), person.sum(0) if len(person) else None, doubtful)

    def _probability(self, image: Float32Array, temperature: float) -> Float32Array:
        logits: Float32Array = self._session.run(None, {self._input: image})[0][0]
        if len(logits) == 1:  # of a sigmoid
            logits = np.concatenate([np.zeros_like(logits), logits])
        exponents = np.exp((logits - logits.max(0)) / np.float32(temperature))
        return np.asarray(exponents / exponents.sum(0), np.float32)


def agree(opinions: Sequence[Opinion]) -> NDArray[np.uint8]:
    """The mask on which all agree.

    Args:
        opinions: of each teacher, all of one size.

    Returns:
        (h, w) uint8: 0 other, 1 grass, 2 person, 255 where they do not agree.
    """
    mask = np.full(opinions[0].doubtful.shape, VOID_ID, np.uint8)
    grass = [o.grass for o in opinions if o.grass is not None]
    person = [o.person for o in opinions if o.person is not None]
    if grass and person:  # only who knows both can say what is neither
        neither = np.logical_and.reduce([p < SURE_NOT for p in (*grass, *person)])
        mask[neither & ~np.logical_or.reduce([o.doubtful for o in opinions])] = OTHER.id
    for class_id, said in ((GRASS.id, grass), (PERSON.id, person)):
        if said:
            mask[np.logical_and.reduce([p > SURE for p in said])] = class_id
    return mask


def write_masks(
    images: Iterable[Path], teachers: Sequence[Teacher], out: Path, report: Callable[[Path], None]
) -> int:
    """Write the teachers' mask of each image to `out/STEM.png`; those that are there stay.

    Returns:
        Number of masks written.
    """
    out.mkdir(parents=True, exist_ok=True)
    written = 0
    for path in images:
        target = out / f"{path.stem}.png"
        if target.exists():
            continue
        image = cv2.imread(str(path))
        if image is None:
            raise InputError(f"cannot read the image {path}: missing or damaged")
        rgb = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
        opinions = [_resized(teacher(rgb), 128) for teacher in teachers]
        _, data = cv2.imencode(".png", agree(opinions))
        partial = target.with_suffix(".partial")
        partial.write_bytes(data.tobytes())
        partial.replace(target)
        written += 1
        report(path)
    return written


def _resized(opinion: Opinion, size: int) -> Opinion:
    def at_size(array: Float32Array | None) -> Float32Array | None:
        return None if array is None else np.asarray(cv2.resize(array, (size, size)), np.float32)

    doubtful = cv2.resize(opinion.doubtful.view(np.uint8), (size, size), interpolation=cv2.INTER_NEAREST)
    return Opinion(at_size(opinion.grass), at_size(opinion.person), doubtful.astype(np.bool_))


def _ids(text: str) -> list[int]:
    return [int(part) for part in text.split(",") if part.strip()]
