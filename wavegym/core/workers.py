"""Where work runs: processes of this machine, or a Ray cluster. ``joblib`` hands it out in either case."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from wavegym.core.errors import InputError, check_choice

PROCESSES, RAY = BACKENDS = ("processes", "ray")


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
    """Run what is handed out inside where the options of ``add_worker_options`` say.

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
