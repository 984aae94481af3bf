"""From an exported .onnx file back to a network that can learn, so that one may begin from the shipped one.

Export folds every batch norm into the convolution before it, and INT8 rounds the weights. Here the weights
are read back, and each batch norm gets the statistics of the training images and the scale and shift that
undo them: the network computes what the file computes, and learns as one that was never folded.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from swardmap.errors import ModelError
from swardmap.models.spec import NetworkSpec
from swardmap.train.build import HEAD, export_shift, fitted_head
from swardmap.train.export import read_spec
from swardmap.train.networks import DeepLabV3Plus

Pair = tuple[str, nn.BatchNorm2d]
FloatArray = NDArray[np.float32]


def load_onnx_weights(
    path: Path, network: DeepLabV3Plus, spec: NetworkSpec, images: Iterable[Tensor]
) -> None:
    """Give a network the weights of a file that `swardmap export` wrote, float32 or INT8.

    Args:
        path: the .onnx file.
        network: of the same encoder and decoder; changed in place, left in eval mode. Of other classes it
            takes what it can of the head, its last layer; see `fitted_head`.
        spec: of the network.
        images: batches (N, 3, H, W), normalised, as the network will be trained on.

    Raises:
        ModelError: for a file that is damaged, or of another network.
    """
    batches = list(images)
    tensors = _read_tensors(path)
    tensors |= _head(tensors, network, spec, path)
    network.eval()
    pairs = _pairs(network, batches[0][:1])
    state = {key: _fitting(tensors, key, value, path) for key, value in _weights(network).items()}
    for conv, norm in pairs:
        shift = tensors.get(f"{conv}.weight_bias", np.zeros(norm.num_features, np.float32))
        if shift.shape != (norm.num_features,):
            raise ModelError(f"{path}: expected {norm.num_features} biases for {conv}, got {shift.shape}")
        _set_norm(
            norm, torch.zeros(norm.num_features), torch.ones(norm.num_features), torch.from_numpy(shift)
        )
    network.load_state_dict(state, strict=False)
    for (_, norm), (mean, variance) in zip(pairs, _statistics(network, pairs, batches), strict=True):
        _set_norm(norm, mean, variance, norm.bias.detach() + mean)


def _head(
    tensors: Mapping[str, FloatArray], network: DeepLabV3Plus, spec: NetworkSpec, path: Path
) -> dict[str, FloatArray]:
    """The last layer as it was before export, for the network's classes."""
    source = read_spec(path)
    if not set(HEAD) <= set(tensors):
        raise ModelError(f"{path}: expected a network of swardmap's, got one without {HEAD[0]}")
    weight, bias = (torch.from_numpy(tensors[key]) for key in HEAD)
    bias = bias - export_shift(source)
    head = fitted_head(dict(zip(HEAD, (weight, bias), strict=True)), network.state_dict(), spec, source)
    return {key: value.numpy() for key, value in head.items()}


@torch.no_grad()
def _set_norm(norm: nn.BatchNorm2d, mean: Tensor, variance: Tensor, shift: Tensor) -> None:
    """Statistics, and a scale and shift with which the layer gives input - mean + shift."""
    assert norm.running_mean is not None  # noqa: S101 - these layers track their statistics
    assert norm.running_var is not None  # noqa: S101
    norm.running_mean.copy_(mean)
    norm.running_var.copy_(variance)
    norm.weight.copy_((norm.running_var + norm.eps).sqrt())
    norm.bias.copy_(shift)


@torch.no_grad()
def _pairs(network: DeepLabV3Plus, image: Tensor) -> list[Pair]:
    """Each batch norm with the name of the convolution whose output it takes, in the order they run."""
    names = {module: name for name, module in network.named_modules()}
    made_by: dict[int, str] = {}
    pairs: list[Pair] = []

    def saw(module: nn.Module, inputs: tuple[Tensor, ...], output: Tensor) -> None:
        if isinstance(module, nn.Conv2d):
            made_by[output.data_ptr()] = names[module]
        elif isinstance(module, nn.BatchNorm2d):
            pairs.append((made_by[inputs[0].data_ptr()], module))

    with _hooked((m for m in network.modules() if isinstance(m, (nn.Conv2d, nn.BatchNorm2d))), saw):
        network(image)
    return pairs


@torch.no_grad()
def _statistics(
    network: DeepLabV3Plus, pairs: list[Pair], batches: list[Tensor]
) -> list[tuple[Tensor, Tensor]]:
    """Mean and variance of what comes into each batch norm."""
    sums: dict[nn.Module, list[Tensor]] = {norm: [] for _, norm in pairs}

    def saw(module: nn.Module, inputs: tuple[Tensor, ...], _: Tensor) -> None:
        x = inputs[0].double()
        sums[module].append(torch.stack([x.mean((0, 2, 3)), (x * x).mean((0, 2, 3))]))

    with _hooked(sums, saw):
        for batch in batches:
            network(batch)
    moments = [torch.stack(sums[norm]).mean(0) for _, norm in pairs]
    return [(m.float(), (s - m * m).clamp(min=1e-6).float()) for m, s in moments]


@contextmanager
def _hooked(modules: Iterable[nn.Module], hook: Any) -> Iterator[None]:
    handles = [module.register_forward_hook(hook) for module in modules]
    try:
        yield
    finally:
        for handle in handles:
            handle.remove()


def _weights(network: DeepLabV3Plus) -> dict[str, Tensor]:
    """All parameters but those of batch norms."""
    norms = tuple(n + "." for n, m in network.named_modules() if isinstance(m, nn.BatchNorm2d))
    return {n: p for n, p in network.named_parameters() if not n.startswith(norms)}


def _fitting(tensors: dict[str, FloatArray], key: str, wanted: Tensor, path: Path) -> Tensor:
    found = tensors.get(key)
    if found is None or found.shape != tuple(wanted.shape):
        raise ModelError(
            f"{path}: expected the recipe's network, with {key} of {tuple(wanted.shape)}, "
            f"got {'none' if found is None else found.shape}"
        )
    return torch.from_numpy(found)


def _read_tensors(path: Path) -> dict[str, FloatArray]:
    """Every constant of the file by its name, INT8 and INT32 ones turned back into float32."""
    import onnx

    if not path.is_file():
        raise ModelError(f"no such network file: {path}")
    try:
        graph = onnx.load(path, load_external_data=False).graph
        found = {i.name: onnx.numpy_helper.to_array(i) for i in graph.initializer}
    except Exception as error:  # protobuf's errors share no narrower base
        raise ModelError(f"{path}: expected an ONNX network, got {error!r:.120}") from error
    floats = {n: v for n, v in found.items() if v.dtype == np.float32}
    for name, value in found.items():
        whole = name.removesuffix("_quantized")
        scale = found.get(f"{whole}_scale", found.get(f"{name}_scale"))
        if whole == name or scale is None or scale.shape != value.shape[:1]:
            continue
        floats[whole] = value.astype(np.float32) * scale.reshape(-1, *[1] * (value.ndim - 1))
    return {n: np.array(v, np.float32) for n, v in floats.items()}
