"""Files: written whole or not at all, and their contents.

CSV and TOML are text. Nested values with arrays are NumPy's npz and JSON, nothing that runs code when it is read.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import tomllib
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError

NOTES = "notes"  # the entry with everything but the arrays, as JSON
MARK = "__array__"  # key of what stands for an array in it: its name
MEMBER = ".npy"
LIMIT = 1 << 32  # bytes of all arrays of a file


def write_whole(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write all files or, on any error, none: earlier ones then stay as they were.

    Every file is first written in full beside its destination and flushed to the disk. Then all files get their names,
    in the order given. If the process is killed between two of these renames, the first files are new and the others
    old, each of them whole. So the file that describes the others belongs last. An earlier kill leaves hidden ``.part``
    files.

    Raises:
        InputError: a folder stands where a file is to be written.
        OSError: the folder cannot be made or written, or the disk is full; names the file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in contents:
        if (folder / name).is_dir():
            raise InputError(f"{folder / name} is a folder, expected a file or nothing in its place")
    staged = {folder / name: folder / f".{name}.{os.getpid()}.part" for name in contents}
    try:
        for (path, part), content in zip(staged.items(), contents.values(), strict=True):
            with _blamed_on(path), part.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        for path, part in staged.items():
            with _blamed_on(path):
                os.replace(part, path)
    finally:
        for part in staged.values():
            part.unlink(missing_ok=True)
    _flush_names(folder)


@contextmanager
def _blamed_on(path: Path) -> Iterator[None]:
    """Make an OSError name the destination, not the hidden file beside it."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def _flush_names(folder: Path) -> None:
    """Make the new names last through a power cut, where the system can open a folder (not on Windows)."""
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def csv_text(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """The text of a CSV file with a head."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()


def read_toml(what: str, file: Path | str) -> dict[str, Any]:
    """The content of a TOML file.

    Args:
        what: the file's part, for an error, such as ``"scenario"``.
        file: its path.

    Raises:
        InputError: the file cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(Path(file).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:  # ValueError: no UTF-8, or no TOML
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{what} {str(file)!r} cannot be read: {reason}") from None


def toml_key(name: str) -> str:
    """A key: bare where that is possible, otherwise quoted."""
    is_bare = name.isascii() and name.replace("-", "").replace("_", "").isalnum()
    return name if is_bare else toml_value(name)


def toml_value(value: Any) -> str:
    """A string, path, number, flag, list, tuple or mapping of these as TOML; a mapping becomes an inline table.

    Raises:
        InputError: anything else, such as None or an object.
    """
    if isinstance(value, Mapping):
        entries = ", ".join(f"{toml_key(key)} = {toml_value(entry)}" for key, entry in value.items())
        return f"{{ {entries} }}" if entries else "{}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return repr(float(value) if isinstance(value, float) else int(value))  # not as NumPy writes its scalars
    if isinstance(value, (str, Path)):
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    raise InputError(f"value is {value!r}, expected a string, number, flag or list of them: TOML has nothing else")


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
