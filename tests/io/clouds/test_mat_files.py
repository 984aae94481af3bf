"""MATLAB files: SciPy reads what we write, we read what SciPy writes, and damage never crashes us."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.io import loadmat, savemat

from swardmap.errors import InputError
from swardmap.io.clouds.mat_files import read_mat, write_mat

TYPES = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
HEADER = b"MATLAB 5.0".ljust(124) + b"\x00\x01IM"
any_array = st.sampled_from(TYPES).flatmap(
    lambda dtype: arrays.arrays(dtype, arrays.array_shapes(min_dims=2, max_dims=4, max_side=5))
)
quick = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=100)


@given(any_array, st.booleans())
@quick
def test_we_read_what_scipy_writes(tmp_path: Path, array: np.ndarray, compressed: bool) -> None:
    file = tmp_path / "a.mat"
    savemat(file, {"Before": np.eye(2), "D": array, "Words": "text"}, do_compression=compressed)
    found = read_mat(file, ("D", "Absent"))
    assert list(found) == ["D"]
    np.testing.assert_array_equal(found["D"], loadmat(file)["D"])
    assert found["D"].dtype == array.dtype


@given(any_array)
@quick
def test_scipy_reads_what_we_write(tmp_path: Path, array: np.ndarray) -> None:
    write_mat(tmp_path / "a.mat", {"D": array})
    np.testing.assert_array_equal(loadmat(tmp_path / "a.mat")["D"], array)


def test_big_endian_and_numbers_stored_smaller_than_their_class(tmp_path: Path) -> None:
    def tag(kind: int, data: bytes) -> bytes:
        return np.array([kind, len(data)], ">u4").tobytes() + data.ljust(-(-len(data) // 8) * 8, b"\0")

    flags, size = np.array([6, 0], ">u4").tobytes(), np.array([2, 3], ">i4").tobytes()
    matrix = tag(6, flags) + tag(5, size) + tag(1, b"Depth") + tag(4, np.arange(6, dtype=">u2").tobytes())
    (tmp_path / "a.mat").write_bytes(b"MATLAB".ljust(124) + b"\x01\x00MI" + tag(14, matrix))
    found = read_mat(tmp_path / "a.mat", ("Depth",))["Depth"]
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found, [[0, 2, 4], [1, 3, 5]])  # column by column
    np.testing.assert_array_equal(loadmat(tmp_path / "a.mat")["Depth"], found)


@given(st.binary(max_size=400), st.booleans())
@quick
def test_random_bytes_hold_no_array(tmp_path: Path, content: bytes, headed: bool) -> None:
    (tmp_path / "a.mat").write_bytes((HEADER if headed else b"") + content)
    _ = outcome(tmp_path / "a.mat")


@given(st.data())
@quick
def test_flipped_bytes_give_one_error_or_numbers(tmp_path: Path, data: st.DataObject) -> None:
    file = tmp_path / "a.mat"
    savemat(file, {"D": np.arange(12.0).reshape(3, 4)}, do_compression=data.draw(st.booleans()))
    content = bytearray(file.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    file.write_bytes(content)
    _ = outcome(file)


@pytest.mark.parametrize("compressed", [False, True])
def test_no_truncated_file_passes(tmp_path: Path, compressed: bool) -> None:
    file = tmp_path / "a.mat"
    savemat(file, {"D": np.arange(12.0).reshape(3, 4)}, do_compression=compressed)
    whole = file.read_bytes()
    for length in range(len(whole)):
        file.write_bytes(whole[:length])
        assert not isinstance(outcome(file), np.ndarray), length


def test_a_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    savemat(tmp_path / "a.mat", {"D": np.zeros((500, 500))}, do_compression=True)
    monkeypatch.setattr("swardmap.io.clouds.mat_files.MAX_BYTES", 100_000)
    with pytest.raises(InputError, match="larger than"):
        read_mat(tmp_path / "a.mat", ("D",))


def outcome(file: Path) -> np.ndarray | str | None:
    """The array D, the message of the one error, or None if there is no D."""
    try:
        return read_mat(file, ("D",)).get("D")
    except InputError as error:
        assert str(file) in str(error)  # noqa: PT017 - every outcome is checked by the caller
        return str(error)
