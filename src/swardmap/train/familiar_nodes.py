"""The part of a network file that says how unlike the images it knows an image is.

Its features are the mean of each channel of the last residual sum of each size but the largest, and of what
the decoder averages over the image: the encoder has them anyway. The nodes stand beside the network's and
change nothing of what it gives.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import ModelError
from swardmap.models.spec import UNFAMILIAR

FloatArray = NDArray[np.float64]

PREFIX = "familiar/"
"""Of the names of all nodes and constants that are added."""

FEATURES = f"{PREFIX}features"
MOST_SIGMAS = 8.0
"""Features count as no farther from their mean."""

MOST_LOGIT = 30.0


@dataclass(frozen=True, eq=False)
class Regression:
    """Logit of an image from its features: sum of weights * clip((feature - mean) / scale), and the bias.

    Attributes:
        mean, scale, weights: (n,) float64.
        bias: for all.
    """

    mean: FloatArray
    scale: FloatArray
    weights: FloatArray
    bias: float

    def logits(self, features: FloatArray) -> FloatArray:
        """(N,) logits of (N, n) features."""
        return standardised(features, self.mean, self.scale) @ self.weights + self.bias


def standardised(features: FloatArray, mean: FloatArray, scale: FloatArray) -> FloatArray:
    """Features in standard deviations from their mean, 8 at most."""
    return np.clip((features - mean) / scale, -MOST_SIGMAS, MOST_SIGMAS)


def strip(graph: Any) -> None:
    """Take out of an onnx.GraphProto what an earlier call has added."""
    for group in (graph.node, graph.initializer):
        kept = [item for item in group if not item.name.startswith(PREFIX)]
        del group[:]
        group.extend(kept)
    outputs = [output for output in graph.output if output.name != UNFAMILIAR]
    del graph.output[:]
    graph.output.extend(outputs)


def _encoder_tensors(model: Any) -> list[str]:
    """The last residual sums and what is averaged over the image, as float32 after rounding.

    The largest sum costs as much as all others, and tells nothing that they do not.
    """
    import onnx

    graph = onnx.shape_inference.infer_shapes(model).graph
    shapes = {v.name: [d.dim_value for d in v.type.tensor_type.shape.dim] for v in graph.value_info}
    by_size: dict[int, str] = {}
    averaged = ""
    for node in graph.node:
        shape = shapes.get(node.output[0], [])
        if node.op_type == "Add" and len(shape) == 4 and shape[2] > 1:
            by_size[shape[2]] = node.output[0]
        elif node.op_type in ("ReduceMean", "GlobalAveragePool") and not averaged:
            averaged = node.input[0]
    if not by_size or not averaged:
        raise ModelError(
            "expected a network of `swardmap export`, with residual sums and an average over the image, got "
            f"{len(by_size)} of the one and {'one' if averaged else 'none'} of the other"
        )
    users = {name: node for node in graph.node for name in node.input}
    sizes = sorted(by_size)
    found = [_dequantised(by_size[size], users) for size in sizes[:-1] or sizes]
    return [*dict.fromkeys([*found, averaged])]


def _dequantised(name: str, users: dict[str, Any]) -> str:
    """The tensor as the network goes on with it: a use of the float one beside it would undo INT8 there."""
    for wanted in ("QuantizeLinear", "DequantizeLinear"):
        if name not in users or users[name].op_type != wanted:
            return name
        name = users[name].output[0]
    return name


def add_features(model: Any) -> None:
    """Append to an onnx.ModelProto the nodes that give the features (1, n), as its last output.

    Raises:
        ModelError: for a network without residual sums, or without an average over the image.
    """
    import onnx

    graph, make = model.graph, onnx.helper.make_node
    graph.initializer.append(onnx.numpy_helper.from_array(np.array([2, 3], np.int64), f"{PREFIX}axes"))
    parts = []
    for index, tensor in enumerate(_encoder_tensors(model)):
        parts.append(f"{PREFIX}mean{index}")
        node = make("ReduceMean", [tensor, f"{PREFIX}axes"], [parts[-1]], name=parts[-1], keepdims=0)
        graph.node.append(node)
    graph.node.append(make("Concat", parts, [FEATURES], name=FEATURES, axis=1))
    graph.output.append(onnx.helper.make_tensor_value_info(FEATURES, onnx.TensorProto.FLOAT, None))


def add_score(model: Any, fit: Regression) -> None:
    """Append the regression to the features; its odds take their place among the outputs."""
    import onnx

    graph, n = model.graph, len(fit.mean)
    del graph.output[-1]
    odds = f"{PREFIX}odds"
    constants = {
        "mean": fit.mean, "scale": 1 / fit.scale, "weights": fit.weights.reshape(n, 1), "bias": [fit.bias],
        "low": -MOST_SIGMAS, "high": MOST_SIGMAS, "least": -MOST_LOGIT, "most": MOST_LOGIT,
    }  # fmt: skip
    for name, value in constants.items():
        tensor = onnx.numpy_helper.from_array(np.asarray(value, np.float32), PREFIX + name)
        graph.initializer.append(tensor)
    shape = onnx.numpy_helper.from_array(np.array([1], np.int64), f"{PREFIX}shape")
    graph.initializer.append(shape)
    steps = (
        ("Sub", "mean"), ("Mul", "scale"), ("Clip", "low", "high"), ("MatMul", "weights"), ("Add", "bias"),
        ("Clip", "least", "most"), ("Exp",), ("Reshape", "shape"),
    )  # fmt: skip
    value = FEATURES
    for index, (kind, *used) in enumerate(steps):
        name = UNFAMILIAR if index == len(steps) - 1 else f"{odds}{index}"
        inputs = [value, *(PREFIX + u for u in used)]
        graph.node.append(onnx.helper.make_node(kind, inputs, [name], name=f"{odds}{index}"))
        value = name
    graph.output.append(onnx.helper.make_tensor_value_info(UNFAMILIAR, onnx.TensorProto.FLOAT, [1]))


def score_of(model: Any) -> Regression:
    """The regression in an onnx.ModelProto that has a score.

    Raises:
        ModelError: for one without.
    """
    import onnx

    found = {
        t.name[len(PREFIX) :]: onnx.numpy_helper.to_array(t).astype(np.float64)
        for t in model.graph.initializer
        if t.name.startswith(PREFIX)
    }
    if missing := {"mean", "scale", "weights", "bias"} - found.keys():
        raise ModelError(
            f"expected a network that scores how unfamiliar an image is, it lacks {sorted(missing)}"
        )
    bias = float(found["bias"].ravel()[0])
    return Regression(found["mean"], 1 / found["scale"], found["weights"].ravel(), bias)
