"""Networks through ONNX Runtime: any file that carries swardmap's metadata, on any execution provider.

Measured choices (reference figures in docs/models.md): optimisation ALL, one thread a core up to 4, no
spinning (a robot's cores are not free).
"""

import math
import os
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import SegmenterConfig
from swardmap.errors import ConfigError, ModelError
from swardmap.io.door import reading
from swardmap.labels import LabelSet
from swardmap.models import network_file
from swardmap.models.network_io import decide, preprocess, segmentation_of
from swardmap.models.spec import METADATA_KEY, UNFAMILIAR, NetworkSpec
from swardmap.types import Frame, Segmentation

Float32Array = NDArray[np.float32]

CPU_PROVIDER = "CPUExecutionProvider"
MOST_THREADS = 4
"""More are taken only where they are asked for."""


class OnnxSegmenter:
    """A network in an .onnx file.

    Attributes:
        spec: what the file says about itself.
        provider: the ONNX Runtime execution provider that really runs it.
        concurrent: several threads may call it at once; each has an input buffer of its own.
    """

    concurrent = True

    def __init__(self, path: Path, threads: int = 0, provider: str = CPU_PROVIDER) -> None:
        self._session = _open_session(path, threads, provider)
        self.spec = _read_spec(self._session, path)
        self.provider = provider
        self._input = _input_name(self._session, self.spec, path)
        self._outputs = _output_names(self._session, self.spec, path)
        self._own = threading.local()
        _check_output(self._run, self.spec, path)

    @property
    def name(self) -> str:
        """Name of the network."""
        return self.spec.name

    @property
    def label_set(self) -> LabelSet:
        """Classes of its masks."""
        return self.spec.label_set

    def __call__(self, frame: Frame) -> Segmentation:
        """Classes of the frame with calibrated probabilities, at the network's size."""
        preprocess(frame.rgb, self.spec, self._buffer())
        logits, *score = self._run()
        found = segmentation_of(logits, self.spec)
        limit = self.spec.unfamiliar_limit
        return found if limit is None else replace(found, unfamiliar=_share_of(score[0], limit))

    def segment(self, rgb: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], Float32Array]:
        """Class and its probability for each pixel.

        Args:
            rgb: (H, W, 3) uint8.

        Returns:
            (h, w) uint8 class ids and (h, w) float32, h x w being the network's output size.
        """
        return decide(self.logits(rgb), self.spec)

    def logits(self, rgb: NDArray[np.uint8]) -> Float32Array:
        """(1, channels, h, w) float32: what the network says of an (H, W, 3) uint8 image, at its own size."""
        preprocess(rgb, self.spec, self._buffer())
        return self._run()[0]

    def _buffer(self) -> Float32Array:
        """The input of this thread."""
        kept: Float32Array | None = getattr(self._own, "buffer", None)
        if kept is None:
            kept = self._own.buffer = np.zeros((1, 3, self.spec.height, self.spec.width), np.float32)
        return kept

    def _run(self) -> list[Float32Array]:
        """Logits of the image in this thread's buffer, and how unfamiliar it is, if the network says so."""
        outputs: list[Float32Array] = self._session.run(self._outputs, {self._input: self._buffer()})
        return outputs


def open_segmenter(
    config: SegmenterConfig,
    source_label_set: LabelSet | None = None,  # noqa: ARG001 - the module contract
) -> OnnxSegmenter:
    """Load the network that the configuration names; those of `BUNDLED_FILES` are bundled.

    Raises:
        ModelError: for a file that is missing, damaged, or no network of swardmap's.
        ConfigError: for a provider that this ONNX Runtime does not have.
    """
    path = network_file(config.name)
    if path is None:
        raise ModelError(f"this package holds no network '{config.name}'; name an .onnx file, or colour")
    return OnnxSegmenter(path, config.threads, config.provider)


def default_threads() -> int:
    """One thread for each core that this process may use, 4 at most.

    Two cores map two cameras at 15 frames a second with two threads, and not with one (docs/robot.md).
    Threads that wait do not spin, so that they take no core from others.
    """
    return min(MOST_THREADS, usable_cores())


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _open_session(path: Path, threads: int, provider: str) -> Any:
    import onnxruntime

    if not path.is_file():
        raise ModelError(f"no such network file: {path}")
    available = onnxruntime.get_available_providers()
    if provider not in available:
        raise ConfigError(
            f"execution provider {provider}: this ONNX Runtime offers {', '.join(available)}; "
            "choose one, or install the build that has it in place of onnxruntime (onnxruntime-openvino, "
            "onnxruntime-gpu)"
        )
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads or default_threads()
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
    options.log_severity_level = 4  # faults are raised below, once
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=[provider])
    except Exception as error:  # the runtime's exceptions share no narrower base
        raise ModelError(
            f"{path}: expected an ONNX network, got a file that does not load; "
            f"it may be cut short or of another kind ({_first_line(error)})"
        ) from error
    running = session.get_providers()[0]
    if running != provider:
        raise ModelError(f"{path}: expected to run on {provider}, but ONNX Runtime fell back to {running}")
    return session


def _read_spec(session: Any, path: Path) -> NetworkSpec:
    with reading(path, "an ONNX network with metadata in UTF-8", ModelError):
        text = session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
    if text is None:
        raise ModelError(
            f"{path}: expected the metadata '{METADATA_KEY}' (input size, classes), got a network without; "
            "make the file with `swardmap export`"
        )
    return NetworkSpec.from_json(text, str(path))


def _input_name(session: Any, spec: NetworkSpec, path: Path) -> str:
    inputs, outputs = session.get_inputs(), session.get_outputs()
    if len(inputs) != 1 or not outputs or inputs[0].type != "tensor(float)":
        raise ModelError(
            f"{path}: expected one float input and an output, got {[(i.name, i.type) for i in inputs]} "
            f"and {len(outputs)} outputs"
        )
    wanted = (1, 3, spec.height, spec.width)
    shape = inputs[0].shape
    fits = len(shape) == 4 and all(
        not isinstance(n, int) or n == w for n, w in zip(shape, wanted, strict=True)
    )
    if not fits:
        raise ModelError(f"{path}: its metadata says input {wanted}, the network takes {shape}")
    name: str = inputs[0].name
    return name


def _output_names(session: Any, spec: NetworkSpec, path: Path) -> list[str]:
    """The logits, which come first, and the score of how unfamiliar an image is, if there is one."""
    names = [output.name for output in session.get_outputs()]
    if spec.unfamiliar_limit is None:
        return names[:1]
    if UNFAMILIAR not in names[1:]:
        raise ModelError(
            f"{path}: its metadata has an unfamiliar_limit, expected an output '{UNFAMILIAR}' after the "
            f"first, got {names}; make the file with `swardmap export`"
        )
    return [names[0], UNFAMILIAR]


def _check_output(run: Callable[[], list[Float32Array]], spec: NetworkSpec, path: Path) -> None:
    try:
        logits, *score = run()
    except Exception as error:
        raise ModelError(f"{path}: the network loads but does not run: {_first_line(error)}") from error
    shape = getattr(logits, "shape", ())
    if len(shape) != 4 or shape[:2] != (1, spec.channels) or getattr(logits, "dtype", None) != np.float32:
        raise ModelError(
            f"{path}: its metadata says {spec.channels} output channels ({spec.activation}), "
            f"expected float32 (1, {spec.channels}, h, w), got {getattr(logits, 'dtype', '?')} {shape}"
        )
    if score and np.size(score[0]) != 1:
        raise ModelError(f"{path}: expected one number as '{UNFAMILIAR}', got {np.shape(score[0])}")


def _share_of(score: Float32Array, limit: float) -> float:
    """The score against its limit; what is no number is as unfamiliar as can be."""
    value = float(np.asarray(score).reshape(-1)[0]) / limit
    return value if value >= 0 else math.inf


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
