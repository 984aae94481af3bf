"""Write ATTRIBUTION.md of the asset package from the indices of its bundles.

python -m tools.bake_assets.attribution garden_assets/swardmap_garden_assets
"""

import sys
from pathlib import Path

from swardmap.io.files import write_text
from swardmap.synth.assets import Assets, open_assets

HEAD = """# Who made the garden assets

Written by `python -m tools.bake_assets.attribution` from the sources that the bundles name for each asset.

- CC0-1.0: <https://creativecommons.org/publicdomain/zero/1.0/>
- CC-BY-3.0: <https://creativecommons.org/licenses/by/3.0/>
- CC-BY-3.0-US: <https://creativecommons.org/licenses/by/3.0/us/>
- MIT: the text is in LICENSE
- Apache-2.0: the text is in LICENSE-Apache-2.0

"""


def document(assets: Assets) -> str:
    """The whole file."""
    return HEAD + assets.attribution()


def main() -> None:
    """Write the file beside the bundles."""
    folder = Path(sys.argv[1])
    write_text(folder / "ATTRIBUTION.md", document(open_assets(folder)))


if __name__ == "__main__":
    main()
