"""Messages are one line that a person reads, and what they say to do stays whole."""

import pytest

from swardmap.errors import MAX_MESSAGE, InputError, one_line

REMEDY = "choose another folder, give the same settings, or pass --overwrite to replace what is there"


@pytest.mark.parametrize("value", ["x" * 900, "/home/me/" + "deep/" * 150 + "drive.mcap"])
@pytest.mark.parametrize("quoted", ["'{}'", "{}"])
def test_a_long_value_is_cut_in_its_middle_and_the_remedy_is_whole(value: str, quoted: str) -> None:
    text = f"expected a folder that is empty, got {quoted.format(value)}, which holds a map; {REMEDY}"
    line = one_line(InputError(text))
    assert len(line) <= MAX_MESSAGE
    assert line.startswith("expected a folder that is empty, got")
    assert line.endswith(f", which holds a map; {REMEDY}")
    assert value[-10:] in line


def test_a_long_text_keeps_its_end_from_the_last_stop_on() -> None:
    line = one_line("word " * 100 + "; " + REMEDY)
    assert len(line) <= MAX_MESSAGE
    assert line.endswith(f" ... {REMEDY}")
    endless = one_line("word " * 100)
    assert len(endless) <= MAX_MESSAGE
    assert endless.endswith("word")


def test_what_fits_is_left_alone() -> None:
    assert one_line("a  b\nc") == "a b c"
    assert one_line("x" * 200) == "x" * 200
    assert one_line("y" * 200, 80).endswith(" ...")
