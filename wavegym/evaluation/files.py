"""Files that are written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path


def write_whole(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write all files or, on any error, none: earlier ones then stay as they were.

    Every file is first written in full and flushed to the disk beside its destination; only when all are there do they
    take their names, in the order given.

    Raises:
        OSError: the folder cannot be made or written, or the disk is full; names the file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    staged = {folder / name: folder / f".{name}.{os.getpid()}.part" for name in contents}
    try:
        for (path, part), content in zip(staged.items(), contents.values(), strict=True):
            _write(part, content, path)
        for path, part in staged.items():
            os.replace(part, path)
    finally:
        for part in staged.values():
            part.unlink(missing_ok=True)
    _flush_names(folder)


def _write(part: Path, content: bytes, path: Path) -> None:
    try:
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
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
