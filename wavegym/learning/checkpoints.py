"""Checkpoint files: incomplete files are recognised, the last two are kept."""

from __future__ import annotations

import hashlib
import re
import sys
from pathlib import Path

from wavegym.core.errors import InputError
from wavegym.evaluation.files import write_whole

MAGIC = b"wavegym checkpoint 1\n"
LENGTH = 8  # bytes of the content's length, then its SHA-256, then the content
KEPT = 2
HEADER = len(MAGIC) + LENGTH + hashlib.sha256().digest_size


def save_checkpoint(folder: Path, steps: int, content: bytes) -> None:
    """Write ``content`` as the checkpoint after ``steps``; remove half-written files and all but the last two.

    Raises:
        OSError: a full disk, for example; earlier checkpoints are kept.
    """
    header = MAGIC + len(content).to_bytes(LENGTH, "big") + hashlib.sha256(content).digest()
    write_whole(folder, {f"step-{steps:012d}.ckpt": header + content})
    for old in [*_listed(folder)[:-KEPT], *folder.glob(".*.part")]:
        old.unlink()


def load_checkpoint(folder: Path) -> tuple[int, bytes] | None:
    """Steps and content of the last intact checkpoint; None if the folder holds no checkpoint.

    A torn checkpoint is skipped with a line on standard error. No file is deleted.

    Raises:
        InputError: there are checkpoints, and none of them is intact.
    """
    paths = _listed(folder)
    for path in reversed(paths):
        content = _content(path)
        if content is not None:
            return int(path.stem.removeprefix("step-")), content
        print(f"checkpoint {path} is torn, skipped", file=sys.stderr)
    if paths:
        raise InputError(f"none of the {len(paths)} checkpoints in {folder} is intact, expected one to resume from")
    return None


def _listed(folder: Path) -> list[Path]:
    """The checkpoints, oldest first."""
    return sorted(p for p in folder.glob("step-*.ckpt") if re.fullmatch(r"step-\d{12}", p.stem))


def _content(path: Path) -> bytes | None:
    """The content of a checkpoint; None if the file is torn."""
    data = path.read_bytes()
    head, content = data[:HEADER], data[HEADER:]
    length, digest = head[len(MAGIC) : len(MAGIC) + LENGTH], head[len(MAGIC) + LENGTH :]
    whole = data.startswith(MAGIC) and len(content) == int.from_bytes(length, "big")
    return content if whole and hashlib.sha256(content).digest() == digest else None
