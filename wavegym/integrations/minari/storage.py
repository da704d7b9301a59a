"""Minari's datasets in a folder of the user's choice; by itself Minari writes to the home folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import minari
from minari import MinariDataset

from wavegym.core.errors import InputError, nearest

VARIABLE = "MINARI_DATASETS_PATH"


@contextmanager
def stored_in(folder: Path | str) -> Iterator[None]:
    """Inside this context, Minari's functions find and write their datasets in ``folder``."""
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(Path(folder).absolute())
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


def load(folder: Path | str, dataset_id: str) -> MinariDataset:
    """A dataset that ``collect`` wrote to ``folder``.

    Raises:
        InputError: there is no such dataset (nearest named).
    """
    with stored_in(folder):
        found = list(minari.list_local_datasets())
        if dataset_id not in found:
            listed = f"one of {', '.join(found)}" if found else "the folder of a dataset"
            raise InputError(f"{folder} has no dataset {dataset_id!r}, expected {listed}{nearest(dataset_id, found)}")
        return minari.load_dataset(dataset_id)
