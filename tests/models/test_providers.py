"""Other providers of ONNX Runtime give the masks that the CPU gives, where they are installed."""

from pathlib import Path

import numpy as np
import pytest

import swardmap
from swardmap.cli.options import PROVIDERS, provider_name
from swardmap.config import SegmenterConfig, config_from_dict
from swardmap.errors import ConfigError
from swardmap.io import open_source
from swardmap.models import build_segmenter

DEMO = Path(swardmap.__file__).parent / "data" / "demo"


@pytest.mark.parametrize("word", ["openvino", "cuda"])
def test_a_provider_gives_the_masks_of_the_cpu_or_says_how_to_get_it(word: str) -> None:
    import onnxruntime

    name = provider_name(word)
    assert name == PROVIDERS[word]
    config = SegmenterConfig(provider=name)
    if name not in onnxruntime.get_available_providers():
        with pytest.raises(ConfigError, match=r"install the build that has it .*onnxruntime-openvino"):
            build_segmenter(config)
        return
    cpu, other = build_segmenter(SegmenterConfig(threads=1)), build_segmenter(config)
    for frame in open_source(DEMO, config_from_dict({"source": {"stop": 2}})):
        a, b = cpu(frame), other(frame)
        assert np.mean(a.labels == b.labels) > 0.99
