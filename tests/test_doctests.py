"""The examples in docstrings give what they say."""

import doctest
import importlib

import pytest

WITH_EXAMPLES = ("swardmap.types", "swardmap.grid", "swardmap.eval.dmin")


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_in_docstrings(name: str) -> None:
    failed, tried = doctest.testmod(importlib.import_module(name))
    assert tried > 0
    assert failed == 0
