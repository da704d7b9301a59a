"""Work handed to several processes, and kept until all of it is done."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from joblib import Parallel
from tqdm import tqdm

from wavegym.core.errors import whole

PACKAGE = Path(__file__).parents[1]
PREFIX = ".played-"


def check_jobs(jobs: int) -> None:
    """InputError for a number of processes that is neither -1, one for each core, nor at least 1."""
    if jobs != -1:
        whole("jobs", jobs, 1)


def each(jobs: int, title: str, work: Sequence[Any]) -> list[Any]:
    """The results of joblib's delayed calls in their order, with a bar on a terminal."""
    results: Iterable[Any] = Parallel(n_jobs=jobs, return_as="generator")(work)
    return list(tqdm(results, total=len(work), desc=title, unit="batch", disable=None))


@contextmanager
def kept(folder: Path) -> Iterator[Path]:
    """A hidden folder in ``folder`` for results of parts, gone when the block ends well.

    After an interruption it stays, and the same call goes on from there. Its name carries a hash of the package's
    sources: what other code has played is not taken up.
    """
    digest = hashlib.sha256()
    for source in sorted(PACKAGE.rglob("*.py")):
        digest.update(source.read_bytes())
    folder.mkdir(parents=True, exist_ok=True)
    yield folder / f"{PREFIX}{digest.hexdigest()[:16]}"
    for store in folder.glob(f"{PREFIX}*"):
        shutil.rmtree(store, ignore_errors=True)
