"""Move the bias of grass in a finished network file, and measure it anew: no checkpoint is needed.

    python tools/shift_grass.py lawn.onnx 1.3 -o new.onnx --recipe recipes/lawn-robots-fine.yaml --data ROOT

Adds to the logit of grass in the head of an INT8 file that `swardmap export` wrote. Its temperature and its
figures are fitted and measured anew on the recipe's validation sets; those of before, which say what INT8
cost, stay in it as `at_export`. What the file says of its training names the sum of all such biases, as
`--grass-bias` would.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper

from swardmap.labels import Role
from swardmap.train.calibrate import fit_temperature
from swardmap.train.data import load_photos
from swardmap.train.export import read_spec, with_spec, write_model
from swardmap.train.recipe import load_recipe
from swardmap.train.release import measured

HEAD = "segmentation_head.0.bias_quantized"


def main() -> None:
    """Read, shift, measure, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("network", type=Path)
    parser.add_argument("bias", type=float)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--recipe", type=Path, required=True)
    parser.add_argument("--data", type=Path, required=True)
    options = parser.parse_args()
    spec, model = read_spec(options.network), onnx.load(options.network)
    roles = {c.id: c.role for c in spec.label_set.classes}
    shift(model, [roles[i] is Role.FREE for i in spec.channel_ids], options.bias)
    bias = round(float(spec.training.get("grass_bias", 0.0)) + options.bias, 4)
    write_model(model, replace(spec, training={**spec.training, "grass_bias": bias}), options.out)
    held = load_photos(load_recipe(options.recipe), options.data, validation=True)
    photos = {s.config.name: s.photos for s in held}
    temperature = fit_temperature(options.out, photos)
    figures = measured(options.out, photos)
    metrics = dict(spec.metrics)
    before = {k: metrics.pop(k) for k in ("float32", "int8") if k in metrics}
    with_spec(options.out, temperature=temperature, metrics={"int8": figures, "at_export": before, **metrics})
    print(f"grass bias {bias:g}, temperature {temperature:.3f}")
    print("  ".join(f"{k} {v:.4f}" for k, v in figures.items() if v is not None))


def shift(model: onnx.ModelProto, free: list[bool], bias: float) -> None:
    """Add a bias to the outputs that are free ground, in whole steps of the head's scale."""
    tensors = {t.name: t for t in model.graph.initializer}
    steps = numpy_helper.to_array(tensors[HEAD]).copy()
    scale = numpy_helper.to_array(tensors[f"{HEAD}_scale"])
    steps[free] += np.rint(bias / scale[free]).astype(steps.dtype)
    tensors[HEAD].CopyFrom(numpy_helper.from_array(steps, HEAD))


if __name__ == "__main__":
    main()
