"""TOML is read with one-line errors, and what is written reads back the same."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.core.toml import read_toml, toml_key, toml_value

TEXT = st.text(st.characters(exclude_categories=("Cs",)))  # no half of a surrogate pair, which no file can hold
SCALARS = st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | TEXT
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner) | st.dictionaries(TEXT, inner), max_leaves=8)


@given(TEXT, VALUES)
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
