"""Work for several processes, with results that outlive an interruption."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from joblib import Parallel
from tqdm import tqdm

import wavegym
from wavegym.core.errors import check_int

PACKAGES = (Path(wavegym.__file__).parent, Path(__file__).parent)
PREFIX = ".played-"


def check_jobs(jobs: int) -> None:
    """InputError for a number of processes that is neither -1, one for each core, nor at least 1."""
    if jobs != -1:
        check_int("jobs", jobs, 1)


def run_all(jobs: int, title: str, work: Sequence[Any]) -> list[Any]:
    """The results of joblib's delayed calls in their order, with a bar on a terminal."""
    results: Iterable[Any] = Parallel(n_jobs=jobs, return_as="generator")(work)
    return list(tqdm(results, total=len(work), desc=title, unit="batch", disable=None))


@contextmanager
def cache_folder(folder: Path) -> Iterator[Path]:
    """A hidden folder in ``folder`` for partial results; the folder is removed when the block ends without an error.

    After an interruption the hidden folder stays, and the same call continues from there. Its name has a hash of the
    sources of wavegym and of papers: results of other sources are never used.
    """
    folder.mkdir(parents=True, exist_ok=True)
    yield folder / f"{PREFIX}{sources_hash()[:16]}"
    for store in folder.glob(f"{PREFIX}*"):
        shutil.rmtree(store, ignore_errors=True)


def sources_hash() -> str:
    """A hash of all sources in ``PACKAGES``."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        for source in sorted(package.rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()
