"""Renderers for the tests; without OpenGL they are skipped, with the reason."""

from collections.abc import Iterator

import pytest

from swardmap.errors import MissingExtraError
from swardmap.synth.render import GardenRenderer
from tests.synth.render.plots import LENS


def opened(samples: int, blades: bool) -> GardenRenderer:
    try:
        return GardenRenderer(LENS.width, LENS.height, samples, blades=blades)
    except MissingExtraError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def bare() -> Iterator[GardenRenderer]:
    """Without blades of grass."""
    renderer = opened(1, blades=False)
    yield renderer
    renderer.close()


@pytest.fixture(scope="session")
def grassy() -> Iterator[GardenRenderer]:
    """With blades."""
    renderer = opened(4, blades=True)
    yield renderer
    renderer.close()
