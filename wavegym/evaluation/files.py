"""Files that are written whole or not at all, and the text of tables."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from wavegym.core.errors import InputError


def csv_text(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """The text of a CSV file with a head."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()


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
            with _blamed_on(path):
                _write(part, content)
        for path, part in staged.items():
            with _blamed_on(path):
                os.replace(part, path)
    finally:
        for part in staged.values():
            part.unlink(missing_ok=True)
    _flush_names(folder)


def _write(part: Path, content: bytes) -> None:
    with part.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


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
