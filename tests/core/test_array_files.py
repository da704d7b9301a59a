"""Files of arrays: what is written reads back the same, and any other file is a ValueError and takes little memory."""

from __future__ import annotations

import contextlib
import io
import zipfile
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from wavegym.core.array_files import pack_arrays, packed, unpack_arrays, unpacked

KINDS = st.sampled_from([np.float32, np.float64, np.int64, np.uint8, np.bool_])
LEAVES = (
    st.none()
    | st.booleans()
    | st.integers(-(2**200), 2**200)
    | st.floats(allow_nan=False)
    | st.text()
    | arrays.arrays(KINDS, arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4))
)
NAMES = st.text(min_size=1).filter(lambda name: name != "__array__")
VALUES = st.recursive(LEAVES, lambda part: st.lists(part) | st.dictionaries(NAMES, part), max_leaves=12)


def same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and one.tobytes() == other.tobytes()
    if isinstance(one, dict):
        return set(one) == set(other) and all(same(each, other[key]) for key, each in one.items())
    if isinstance(one, list):
        return len(one) == len(other) and all(same(*pair) for pair in zip(one, other, strict=True))
    return type(one) is type(other) and one == other


@pytest.mark.slow
@given(VALUES)
def test_a_value_survives(value: Any) -> None:
    found = unpacked(packed(value))
    assert same(value, found)


def test_arrays_come_back_fresh_and_equal() -> None:
    given = {"W0": np.arange(6.0).reshape(2, 3).T, "b0": np.float32(2.0) * np.ones(())}
    found = unpack_arrays(pack_arrays(given))
    for name, array in given.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].shape == array.shape
        assert found[name].flags.writeable


@given(st.binary(max_size=300), st.data())
def test_a_torn_file_is_a_value_error(noise: bytes, data: st.DataObject) -> None:
    whole = packed({"a": np.arange(5), "b": [1, {"c": np.ones((2, 2))}]})
    at = data.draw(st.integers(0, len(whole)))
    for content in (noise, whole[:at] + noise + whole[at + len(noise) :], whole[:at]):
        with contextlib.suppress(ValueError):
            unpacked(content)


def compressed(member: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", member)
    return file.getvalue()


def test_a_file_that_expands_is_refused_before_it_does() -> None:
    array = io.BytesIO()
    np.save(array, np.zeros(2**20))
    content = compressed(array.getvalue())
    assert len(content) < 2**14
    assert unpack_arrays(content)["a"].shape == (2**20,)
    with pytest.raises(ValueError, match=r"expands to 8388736 bytes, expected at most 1000"):
        unpack_arrays(content, limit=1000)


@pytest.mark.parametrize("shape", ["(1000000000000,)", "(-1,)", "(2, 3)"])
def test_a_header_that_says_more_than_there_is_is_refused(shape: str) -> None:
    file = io.BytesIO()
    np.save(file, np.zeros(5))
    member = file.getvalue().replace(b"(5,), }" + b" " * (len(shape) - 4), f"{shape}, }}".encode())
    assert member != file.getvalue()
    with pytest.raises(ValueError, match=r"has 40 bytes|is no npz file"):
        unpack_arrays(compressed(member))


def test_pickled_objects_are_refused() -> None:
    file = io.BytesIO()
    np.savez(file, a=np.array([{}, []], object))
    with pytest.raises(ValueError, match="an array of object"):
        unpack_arrays(file.getvalue())
