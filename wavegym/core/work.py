"""Work for several processes, on this machine or a Ray cluster, that survives bad nights.

A worker ends when the process that started it ends, in any way. The task of a killed worker is repeated. The next call
does not recompute results that ``Parts`` keeps.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import joblib
from joblib import Parallel, delayed
from joblib.externals.loky.process_executor import TerminatedWorkerError

from wavegym.core.errors import InputError, check_choice
from wavegym.core.files import packed, unpacked

WATCHED_EVERY = 0.5  # s between two looks of a worker at its parent
PACKAGE = Path(__file__).parents[1]
PREFIX = ".played-"
PROCESSES, RAY = BACKENDS = ("processes", "ray")


class Call(NamedTuple):
    """A function of a module and its arguments, to be called in another process."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]


class Parts:
    """Results of finished calls, kept in files for the same command that is started again.

    Args:
        folder: of the files; made when it is first needed.
        kind: NamedTuple of arrays that every call returns.
    """

    def __init__(self, folder: Path, kind: type[Any]) -> None:
        self.folder, self.kind = folder, kind

    def key(self, call: Call) -> str:
        """The file of a call. Compute it before the call, which may change its arguments."""
        return f"{joblib.hash((call.function.__qualname__, call.arguments))}.npz"

    def get(self, key: str) -> Any:
        """The result of the call; None if there is none, or a torn file."""
        with suppress(OSError, ValueError, TypeError):
            return self.kind(**unpacked((self.folder / key).read_bytes()))
        return None

    def put(self, key: str, result: Any) -> None:
        """Keep a result. A file that cannot be written is no loss: the call is then made again."""
        part = (self.folder / key).with_suffix(".part")
        with suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            part.write_bytes(packed(result._asdict()))
            part.replace(self.folder / key)


@contextmanager
def kept_parts(folder: Path | None, kind: type[Any]) -> Iterator[Parts | None]:
    """Parts in a ``hidden_folder``; None without a folder.

    Args:
        folder: of the command's results.
        kind: see ``Parts``.
    """
    if folder is None:
        yield None
        return
    with hidden_folder(folder) as hidden:
        yield Parts(hidden, kind)


@contextmanager
def hidden_folder(folder: Path, *packages: Path) -> Iterator[Path]:
    """The name of a hidden folder in ``folder`` for partial results; it is removed if the block ends without an error.

    The name has a hash of the suite's sources, and of those of ``packages``: results of other sources are never used.
    """
    yield folder / f"{PREFIX}{sources_hash(*packages)[:16]}"
    for store in folder.glob(f"{PREFIX}*"):
        shutil.rmtree(store, ignore_errors=True)


def sources_hash(*packages: Path) -> str:
    """A hash of all sources of the suite, and of other packages' folders."""
    digest = hashlib.sha256()
    for package in (PACKAGE, *packages):
        for source in sorted(package.rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


def run_all(
    calls: Sequence[Call], jobs: int, advance: Callable[[int], None] = lambda count: None, parts: Parts | None = None
) -> list[Any]:
    """The results of all calls, in their order.

    Work is handed out through joblib: inside ``joblib.parallel_config("ray")`` it runs on a Ray cluster.

    Args:
        calls: functions and arguments that can be pickled.
        jobs: processes; -1 = one for each core.
        advance: called with the number of calls that have finished since its last call.
        parts: where results are kept and looked for.

    Raises:
        TerminatedWorkerError: workers were killed twice, most likely for want of memory.
    """
    keys = [] if parts is None else [parts.key(call) for call in calls]
    kept = {} if parts is None else {index: parts.get(key) for index, key in enumerate(keys)}
    results: dict[int, Any] = {index: found for index, found in kept.items() if found is not None}
    advance(len(results))

    def finish() -> None:
        missing = [index for index in range(len(calls)) if index not in results]
        for index, result in _unordered([(index, calls[index]) for index in missing], jobs):
            results[index] = result
            if parts is not None:
                parts.put(keys[index], result)
            advance(1)

    try:
        finish()
    except TerminatedWorkerError as error:
        left = f"{len(calls) - len(results)} of {len(calls)} batches are played again"
        print(f"warning: a worker was killed ({_exit_codes(error)}); {left}", file=sys.stderr)
        finish()
    return [results[index] for index in range(len(calls))]


def _unordered(work: Sequence[tuple[int, Call]], jobs: int) -> Iterator[tuple[int, Any]]:
    """Pairs of index and result as they come, or all at the end where the backend cannot hand them out before."""
    parent: int | None = os.getpid()
    # loky replaces a worker that has grown, as one that compiles kernels does, and warns of it each time
    warnings.filterwarnings("ignore", "A worker stopped while some jobs were given to the executor", UserWarning)
    try:
        hand_out = Parallel(n_jobs=jobs, return_as="generator_unordered")
    except ValueError:  # Ray, whose workers have a parent on their own machine
        hand_out, parent = Parallel(n_jobs=jobs), None
    yield from hand_out(delayed(_in_worker)(parent, index, *call) for index, call in work)


def _in_worker(
    parent: int | None, index: int, function: Callable[..., Any], arguments: tuple[Any, ...]
) -> tuple[int, Any]:
    if parent not in (None, os.getpid()):
        _end_with(parent)
    return index, function(*arguments)


def _end_with(parent: int | None) -> None:
    """End this process when its parent ends, whatever it is doing."""
    if any(thread.name == __name__ for thread in threading.enumerate()):
        return

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCHED_EVERY)
        os._exit(1)

    threading.Thread(target=watch, name=__name__, daemon=True).start()


def _exit_codes(error: TerminatedWorkerError) -> str:
    """joblib's message about exit codes, without its advice."""
    _, _, told = str(error).partition("exit codes of the workers are ")
    return told.partition("\n")[0].strip("{}. ") or "exit code not known"


def add_worker_options(parser: Any, jobs: int = -1, what: str = "processes") -> None:
    """Add --jobs, --backend and --address to an ``argparse`` parser; ``jobs`` is the default."""
    default = "one for each core" if jobs == -1 else jobs
    parser.add_argument("--jobs", type=int, default=jobs, metavar="J", help=f"{what} (default: {default})")
    wanted = f"where the work runs: {PROCESSES} of this machine, or a {RAY} cluster (default: %(default)s)"
    parser.add_argument("--backend", default=PROCESSES, metavar="NAME", help=wanted)
    found = "address of the Ray cluster, such as auto or HOST:6379 (default: a new cluster on this machine)"
    parser.add_argument("--address", metavar="ADDRESS", help=found)


@contextmanager
def workers(options: Any) -> Iterator[None]:
    """Run the work inside where the options of ``add_worker_options`` say.

    Raises:
        InputError: an unknown backend, an address without Ray; see ``cluster``.
    """
    if check_choice("--backend", options.backend, BACKENDS) == RAY:
        with cluster(options.address):
            yield
        return
    if options.address is not None:
        raise InputError(f"--address is {options.address!r}, expected it with --backend ray only")
    yield


@contextmanager
def cluster(address: str | None = None) -> Iterator[None]:
    """``wavegym.evaluation.compare``, and whatever else hands out work through joblib, runs on Ray inside.

    A process that is connected to a cluster stays connected; otherwise the connection ends with the block.

    Args:
        address: as ``ray.init`` takes it, such as "auto" or "HOST:6379"; None starts a cluster on this machine.

    Raises:
        InputError: Ray is not installed, or no cluster answers at the address.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # Ray would report its use over the network
    try:
        import joblib
        import ray
        from ray.util.joblib import register_ray
    except ImportError as error:
        raise InputError(f"a Ray cluster needs Ray: {error}; pip install 'wavegym[ray]'") from None
    connected = ray.is_initialized()
    if not connected:
        try:
            _check_answers(address)
            ray.init(address=address or "local", log_to_driver=False, logging_level="error", include_dashboard=False)
        except (OSError, ValueError) as error:
            raise InputError(f"no Ray cluster answers at {address!r}, expected its address, such as 'auto' or "
                             f"'HOST:6379': {str(error).splitlines()[0]}") from None  # fmt: skip
    register_ray()
    try:
        with joblib.parallel_config("ray"):
            yield
    finally:
        if not connected:
            ray.shutdown()


def _check_answers(address: str | None) -> None:
    """Raise an OSError if HOST:PORT does not answer within 5 s. Ray itself would go on trying for minutes."""
    host, colon, port = (address or "").rpartition(":")
    if colon and port.isdigit():
        socket.create_connection((host.rpartition("//")[2], int(port)), timeout=5.0).close()
