"""Work for several processes; results survive an interruption."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tqdm import tqdm

from wavegym.core import work
from wavegym.core.errors import check_int

Delayed = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]  # of joblib


def check_jobs(jobs: int) -> None:
    """Raise InputError if a number of processes is neither -1 (one for each core) nor at least 1."""
    if jobs != -1:
        check_int("jobs", jobs, 1)


def run_all(jobs: int, title: str, calls: Sequence[Delayed]) -> list[Any]:
    """The results of joblib's delayed calls (without keywords) in order; a terminal shows a progress bar."""
    with tqdm(total=len(calls), desc=title, unit="batch", disable=None) as bar:
        return work.run_all([work.Call(function, arguments) for function, arguments, _ in calls], jobs, bar.update)


@contextmanager
def cache_folder(folder: Path) -> Iterator[Path]:
    """A hidden folder in ``folder`` for partial results; the folder is removed when the block ends without an error.

    After an interruption the hidden folder stays, and the same call continues from there. Its name contains a hash of
    the sources of wavegym and of the papers, so that results of other sources are never used.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with work.hidden_folder(folder, Path(__file__).parent) as hidden:
        yield hidden
