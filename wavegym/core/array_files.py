"""Nested values with arrays as the bytes of one file: NumPy's npz and JSON, nothing that runs code when it is read."""

from __future__ import annotations

import io
import json
import math
import zipfile
from typing import Any

import numpy as np
from numpy.lib import format as npy

from wavegym.core.arrays import Array

NOTES = "notes"  # the entry with everything but the arrays, as JSON
MARK = "__array__"  # key of what stands for an array in it: its name
MEMBER = ".npy"
LIMIT = 1 << 32  # bytes of all arrays of a file


def packed(value: Any) -> bytes:
    """Dictionaries, lists, arrays, strings and numbers, nested as they like; tuples become lists, keys strings."""
    arrays: dict[str, Array] = {}

    def plain(part: Any) -> Any:
        if isinstance(part, np.ndarray):
            name = f"a{len(arrays)}"
            arrays[name] = part
            return {MARK: name}
        if isinstance(part, dict):
            return {str(key): plain(each) for key, each in part.items()}
        return [plain(each) for each in part] if isinstance(part, (list, tuple)) else part

    arrays[NOTES] = np.frombuffer(json.dumps(plain(value)).encode(), np.uint8)
    return pack_arrays(arrays)


def unpacked(content: bytes, limit: int = LIMIT) -> Any:
    """The value of ``packed``, with fresh arrays. Raises a ValueError for other or torn files, and larger ones."""
    arrays = unpack_arrays(content, limit)

    def whole(part: Any) -> Any:
        if isinstance(part, dict):
            return arrays[part[MARK]] if MARK in part else {key: whole(each) for key, each in part.items()}
        return [whole(each) for each in part] if isinstance(part, list) else part

    try:
        return whole(json.loads(arrays.pop(NOTES).tobytes()))
    except (KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"its notes are torn: {type(error).__name__}: {error}") from None


def pack_arrays(arrays: dict[str, Array]) -> bytes:
    """Arrays by name as the bytes of an npz file."""
    file = io.BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def unpack_arrays(content: bytes, limit: int = LIMIT) -> dict[str, Array]:
    """The arrays of an npz file, fresh.

    ``np.load`` allocates an array of the size in its header before it reads it, and does not limit decompression.
    This function checks the sizes first.

    Args:
        content: of the file.
        limit: bytes that the arrays may take together.

    Raises:
        ValueError: not a npz file, or one that is torn, too large or has pickled objects.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(member.file_size for member in archive.infolist())
            if size > limit:
                raise ValueError(f"it expands to {size} bytes, expected at most {limit}")
            return {name.removesuffix(MEMBER): _array(archive.read(name)) for name in archive.namelist()}
    except ValueError:
        raise
    except Exception as error:  # any error of zipfile, zlib and NumPy for incomplete files
        raise ValueError(f"it is no npz file: {type(error).__name__}: {error}") from None


def _array(member: bytes) -> Array:
    stream = io.BytesIO(member)
    version = npy.read_magic(stream)
    read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in read:
        raise ValueError(f"its arrays have the format {version}, expected 1.0 or 2.0")
    shape, is_fortran, dtype = read[version](stream)
    data = member[stream.tell() :]
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(data):
        raise ValueError(f"an array of {dtype} and shape {shape} has {len(data)} bytes")
    return np.frombuffer(data, dtype).reshape(shape, order="F" if is_fortran else "C").copy()
