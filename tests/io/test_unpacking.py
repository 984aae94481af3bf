"""What is packed unpacks to what it was, and to no more than is allowed, whatever it says of itself."""

import bz2
from collections.abc import Callable

import lz4.frame
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.io.unpacking import unbz2, unlz4, unzstd, zstd
from tests.io.memory import memory_below

Unpack = Callable[..., bytes]
KINDS: dict[str, tuple[Callable[[bytes], bytes], Unpack]] = {
    "bz2": (bz2.compress, unbz2),
    "lz4": (lz4.frame.compress, unlz4),
    "zstd": (zstd().compress, unzstd),
}


@pytest.mark.parametrize("kind", KINDS)
@given(parts=st.lists(st.binary(max_size=300), min_size=1, max_size=3))
def test_streams_one_behind_the_other_come_back(kind: str, parts: list[bytes]) -> None:
    pack, unpack = KINDS[kind]
    plain = b"".join(parts)
    assert unpack(b"".join(map(pack, parts)), len(plain)) == plain
    if plain:
        with pytest.raises(ValueError, match=f"more than the {len(plain) - 1} bytes"):
            unpack(b"".join(map(pack, parts)), len(plain) - 1)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bomb_costs_what_is_allowed(kind: str) -> None:
    pack, unpack = KINDS[kind]
    bomb = pack(bytes(2**27))
    with pytest.raises(ValueError, match="more than the 1000 bytes"), memory_below(2**20):
        unpack(bomb, 1000)


@pytest.mark.parametrize("kind", KINDS)
def test_a_stream_that_ends_early_is_refused(kind: str) -> None:
    pack, unpack = KINDS[kind]
    whole = pack(bytes(range(256)) * 40)
    for length in range(1, len(whole)):
        with pytest.raises((ValueError, RuntimeError, OSError)):
            unpack(whole[:length])
