"""Files of arrays and TOML: what goes in comes out.

Whatever else comes in is an error, without large memory.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import tomllib
import zipfile
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from wavegym.core.errors import InputError
from wavegym.core.files import (
    pack_arrays,
    packed,
    read_toml,
    toml_key,
    toml_value,
    unpack_arrays,
    unpacked,
    write_whole,
)

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


TEXT = st.text(st.characters(exclude_categories=("Cs",)))  # no half of a surrogate pair, which no file can hold
TOML_SCALARS = st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | TEXT
TOML_VALUES = st.recursive(TOML_SCALARS, lambda inner: st.lists(inner) | st.dictionaries(TEXT, inner), max_leaves=8)


@given(TEXT, TOML_VALUES)
def test_what_is_written_reads_back_the_same(key, value):
    again = tomllib.loads(f"{toml_key(key)} = {toml_value(value)}")
    assert again == {key: value}
    assert repr(again[key]) == repr(value)  # True is not 1, nor 1.0


def test_numpy_s_scalars_and_tuples_are_written_as_python_s():
    assert toml_value((np.float64(0.1), 2)) == "[0.1, 2]"


@pytest.mark.parametrize("value", [None, object(), [1, None]])
def test_what_toml_lacks_is_refused(value):
    with pytest.raises(InputError, match="expected a string, number, flag or list of them") as caught:
        toml_value(value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"a = ", b"a = 1\na = 2\n", b"a = '\xff'"])
def test_a_file_that_is_no_toml_is_named(tmp_path, content):
    file = tmp_path / "bad.toml"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"scenario '.*bad\.toml' cannot be read: .") as caught:
        read_toml("scenario", file)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="cannot be read: No such file or directory"):
        read_toml("scenario", tmp_path / "none.toml")


def test_an_error_in_the_last_file_leaves_none_of_the_new_ones(tmp_path, monkeypatch):
    write_whole(tmp_path, {"a": b"old", "b": b"old"})
    flushed = []

    def flush(descriptor):
        flushed.append(descriptor)
        if len(flushed) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", flush)
    with pytest.raises(OSError, match=r"No space left on device.*b'"):
        write_whole(tmp_path, {"a": b"new", "b": b"new"})
    assert {name: (tmp_path / name).read_bytes() for name in os.listdir(tmp_path)} == {"a": b"old", "b": b"old"}


@pytest.mark.parametrize("blocked", ["a", "b"])
def test_a_folder_in_the_way_is_named_and_nothing_is_written(tmp_path, blocked):
    other = {"a": "b", "b": "a"}[blocked]
    (tmp_path / other).write_bytes(b"old")
    (tmp_path / blocked).mkdir()
    with pytest.raises(InputError, match=f"{blocked} is a folder, expected a file or nothing") as caught:
        write_whole(tmp_path, {"a": b"new", "b": b"new"})
    assert ".part" not in str(caught.value)
    assert sorted(os.listdir(tmp_path)) == ["a", "b"]
    assert (tmp_path / other).read_bytes() == b"old"


def test_an_error_in_taking_a_name_names_the_destination(tmp_path, monkeypatch):
    def refuse(part, path):
        raise PermissionError(errno.EACCES, "Permission denied", str(part), None, str(path))

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(PermissionError) as caught:
        write_whole(tmp_path, {"a": b"new"})
    assert caught.value.filename == str(tmp_path / "a")
    assert os.listdir(tmp_path) == []
