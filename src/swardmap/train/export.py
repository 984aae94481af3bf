"""From a checkpoint to an .onnx file: export, quantisation, calibration of the confidence, checks.

Quantisation is static, QDQ, unsigned activations and signed weights per channel: on CPUs with VNNI
signed activations take twice as long. The metadata travels inside the file.
"""

import logging
import warnings
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from swardmap.errors import ModelError, require
from swardmap.io.files import output_error, write_bytes
from swardmap.labels import Role
from swardmap.models.network_io import preprocess
from swardmap.models.spec import METADATA_KEY, NetworkSpec
from swardmap.train.augment import Image
from swardmap.train.networks import DeepLabV3Plus

OPSET = 18
INPUT, OUTPUT = "image", "logits"
HEAD_BIAS = "segmentation_head.0.bias_quantized"
AGREEMENT = 1e-2
"""Largest difference of logits, torch against ONNX Runtime in float32, that an export may have."""


def export_onnx(network: DeepLabV3Plus, spec: NetworkSpec, path: Path) -> float:
    """Write the network with its metadata in float32 and compare it with torch.

    Args:
        network: trained.
        spec: what to say about it.
        path: of the .onnx file; replaced whole.

    Returns:
        Largest difference of a logit on a random image.

    Raises:
        ModelError: if the file does not agree with the network.
    """
    require("onnx", "train")
    require("onnxscript", "train")
    network = network.eval().cpu()
    example = torch.randn(1, 3, spec.height, spec.width, generator=torch.Generator().manual_seed(0))
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it tells of packages that nothing needs
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations inside the exporter
        program = torch.onnx.export(
            network,
            (example,),
            dynamo=True,
            opset_version=OPSET,
            input_names=[INPUT],
            output_names=[OUTPUT],
            verbose=False,
        )
    model = program.model_proto
    write_model(model, spec, path)
    with torch.no_grad():
        expected = network(example).numpy()
    got = open_session(path).run(None, {INPUT: example.numpy()})[0]
    difference = float(np.abs(expected - got).max())
    if not difference < AGREEMENT:
        raise ModelError(f"{path}: the exported network differs from torch by {difference:.3g} of a logit")
    return difference


def quantise(source: Path, target: Path, images: Iterable[Image]) -> None:
    """Make the INT8 file of a float32 file, calibrated on real images.

    Args:
        source: as `export_onnx` writes it.
        target: the INT8 file; replaced whole.
        images: (H, W, 3) uint8 RGB, some dozens.
    """
    import onnx
    from onnxruntime.quantization import CalibrationMethod, QuantFormat, QuantType, quantize_static
    from onnxruntime.quantization.shape_inference import quant_pre_process

    spec = read_spec(source)
    prepared = target.with_suffix(".prepared.onnx")
    partial = target.with_suffix(".partial.onnx")
    try:
        quant_pre_process(str(source), str(prepared), skip_symbolic_shape=True)
        nodes = onnx.load(prepared).graph.node
        last = [n.name for n in nodes if n.op_type == "Resize" and OUTPUT in n.output]  # logits stay float32
        quantize_static(
            str(prepared),
            str(partial),
            _reader(images, spec),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            calibrate_method=CalibrationMethod.MinMax,
            nodes_to_exclude=last,
        )
        write_model(onnx.load(partial), spec, target)
    finally:
        prepared.unlink(missing_ok=True)
        partial.unlink(missing_ok=True)


def with_spec(path: Path, **changes: Any) -> NetworkSpec:
    """Change what a network file says about itself, and write it back whole."""
    import onnx

    spec = replace(read_spec(path), **changes)
    write_model(onnx.load(path), spec, path)
    return spec


def shift_grass(path: Path, bias: float) -> NetworkSpec:
    """Add a bias to the logits of what may be driven on, in an INT8 file, in whole steps of the head's scale.

    What the file says of its training names the sum of all such biases.

    Args:
        path: as `quantise` writes it; replaced whole.
        bias: of the logit.
    """
    import onnx
    from onnx import numpy_helper

    spec, model = read_spec(path), onnx.load(path)
    roles = {c.id: c.role for c in spec.label_set.classes}
    free = [roles[i] is Role.FREE for i in spec.channel_ids]
    tensors = {t.name: t for t in model.graph.initializer}
    steps = numpy_helper.to_array(tensors[HEAD_BIAS]).copy()
    scale = numpy_helper.to_array(tensors[f"{HEAD_BIAS}_scale"])
    steps[free] += np.rint(bias / scale[free]).astype(steps.dtype)
    tensors[HEAD_BIAS].CopyFrom(numpy_helper.from_array(steps, HEAD_BIAS))
    total = round(float(spec.training.get("grass_bias", 0.0)) + bias, 4)
    spec = replace(spec, training={**spec.training, "grass_bias": total})
    write_model(model, spec, path)
    return spec


def read_spec(path: Path) -> NetworkSpec:
    """What a network file says about itself, without running it.

    Raises:
        ModelError: if it is missing, or no network of swardmap's.
    """
    import onnx

    if not path.is_file():
        raise ModelError(f"no such network: {path}")
    metadata = {p.key: p.value for p in onnx.load(path, load_external_data=False).metadata_props}
    if METADATA_KEY not in metadata:
        raise ModelError(f"{path}: expected the metadata '{METADATA_KEY}', got a network without")
    return NetworkSpec.from_json(metadata[METADATA_KEY], str(path))


def _reader(images: Iterable[Image], spec: NetworkSpec) -> Any:
    from onnxruntime.quantization import CalibrationDataReader

    class Reader(CalibrationDataReader):
        def __init__(self) -> None:
            self.images = iter(images)

        def get_next(self) -> dict[str, NDArray[np.float32]] | None:
            image = next(self.images, None)
            if image is None:
                return None
            buffer = np.zeros((1, 3, spec.height, spec.width), np.float32)
            preprocess(image, spec, buffer)
            return {INPUT: buffer}

    return Reader()


def open_session(source: Path | bytes) -> Any:
    """A session of ONNX Runtime on the CPU, of a file or of what would stand in it."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    given = source if isinstance(source, bytes) else str(source)
    return onnxruntime.InferenceSession(given, options, providers=["CPUExecutionProvider"])


def write_model(model: Any, spec: NetworkSpec, path: Path) -> None:
    """Write a model with what it says about itself; the file is replaced whole."""
    import onnx

    graph = model.graph
    for part in (
        model,
        graph,
        *graph.node,
        *graph.value_info,
        *graph.initializer,
        *graph.input,
        *graph.output,
    ):
        part.doc_string = ""
        del part.metadata_props[:]  # the exporter tells call stacks, with the paths of this machine
    onnx.helper.set_model_props(model, {METADATA_KEY: spec.to_json()})
    model.producer_name = "swardmap"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise output_error(path, error) from error
    write_bytes(path, model.SerializeToString())
