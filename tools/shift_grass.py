"""Move the bias of grass in a finished network file, and measure it anew: no checkpoint is needed.

    python tools/shift_grass.py lawn.onnx 1.3 -o new.onnx --recipe recipes/lawn-robots-fine.yaml --data ROOT

Adds to the logit of grass in the head of an INT8 file that `swardmap export` wrote. Its temperature and its
figures are fitted and measured anew on the recipe's validation sets; those of before, which say what INT8
cost, stay in it as `at_export`. What the file says of its training names the sum of all such biases, as
`--grass-bias` would.
"""

import argparse
import shutil
from pathlib import Path

from swardmap.train.calibrate import fit_temperature
from swardmap.train.data import load_photos
from swardmap.train.export import shift_grass, with_spec
from swardmap.train.recipe import load_recipe
from swardmap.train.release import measured


def main() -> None:
    """Read, shift, measure, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("network", type=Path)
    parser.add_argument("bias", type=float)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--recipe", type=Path, required=True)
    parser.add_argument("--data", type=Path, required=True)
    options = parser.parse_args()
    shutil.copyfile(options.network, options.out)
    spec = shift_grass(options.out, options.bias)
    held = load_photos(load_recipe(options.recipe), options.data, validation=True)
    photos = {s.config.name: s.photos for s in held}
    temperature = fit_temperature(options.out, photos)
    figures = measured(options.out, photos)
    metrics = dict(spec.metrics)
    before = {k: metrics.pop(k) for k in ("float32", "int8") if k in metrics}
    with_spec(options.out, temperature=temperature, metrics={"int8": figures, "at_export": before, **metrics})
    print(f"grass bias {spec.training['grass_bias']:g}, temperature {temperature:.3f}")
    print("  ".join(f"{k} {v:.4f}" for k, v in figures.items() if v is not None))


if __name__ == "__main__":
    main()
