"""How far a CPU's INT8 kernels are from what an INT8 file says: masks of one file differ between machines.

    python benchmarks/score_kernels.py auto --images ~/photos/robot_lawns/images --count 12

What the file says is ONNX Runtime without any fusion: scales, rounding and products one by one, in float32.
Beside it the kernels that a robot uses, and those of `session.x64quantprecision`, which x86 CPUs without VNNI
need lest a sum of two products overflow its 16 bits. Processor time is of one thread.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from swardmap.io.images import read_color
from swardmap.models import bundled_network
from swardmap.models.network_io import decide, preprocess
from swardmap.train.export import read_spec

LEVELS = onnxruntime.GraphOptimizationLevel
KINDS = {
    "as the file says": (LEVELS.ORT_DISABLE_ALL, "0"),
    "as a robot runs it": (LEVELS.ORT_ENABLE_ALL, "0"),
    "x64quantprecision": (LEVELS.ORT_ENABLE_ALL, "1"),
}


def session_of(path: Path, kind: str) -> onnxruntime.InferenceSession:
    """One thread, with the kernels of a kind."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.graph_optimization_level, precise = KINDS[kind]
    options.add_session_config_entry("session.x64quantprecision", precise)
    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("network", help="an INT8 .onnx file, or auto")
    parser.add_argument("--images", type=Path, required=True, help="folder of photos")
    parser.add_argument("--count", type=int, default=12)
    arguments = parser.parse_args()
    path = bundled_network() if arguments.network == "auto" else Path(arguments.network)
    if path is None:
        raise SystemExit("this package holds no network")
    spec = read_spec(path)
    photos = [read_color(p) for p in sorted(arguments.images.iterdir())[: arguments.count]]
    said: list[NDArray[np.float32]] = []
    print("| kernels | mean difference of logits | 99 % below | pixels of another class % | ms of a core |")
    print("|---|---:|---:|---:|---:|")
    for kind in KINDS:
        session, logits, spent = session_of(path, kind), [], 0.0
        for photo in photos:
            buffer = np.zeros((1, 3, spec.height, spec.width), np.float32)
            preprocess(photo, spec, buffer)
            began = time.process_time()
            logits.append(session.run(None, {session.get_inputs()[0].name: buffer})[0])
            spent += time.process_time() - began
        said = said or logits
        off = np.concatenate([np.abs(a - b).ravel() for a, b in zip(logits, said, strict=True)])
        other = [np.mean(decide(a, spec)[0] != decide(b, spec)[0]) for a, b in zip(logits, said, strict=True)]
        print(
            f"| {kind} | {off.mean():.3f} | {np.quantile(off, 0.99):.3f} | {100 * np.mean(other):.2f} | "
            f"{1000 * spent / len(photos):.0f} |"
        )


if __name__ == "__main__":
    main()
