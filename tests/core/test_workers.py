"""Options that choose where work runs, and their mistakes; test_ray_cluster.py has a Ray cluster itself."""

from __future__ import annotations

import importlib.util

import joblib
import pytest

from wavegym.core.command_line import Parser
from wavegym.core.errors import InputError
from wavegym.core.work import add_worker_options, workers


def options(*given):
    parser = Parser()
    add_worker_options(parser, jobs=3)
    return parser.read(given)


def test_processes_are_the_default_and_leave_joblib_alone():
    chosen = options()
    assert (chosen.jobs, chosen.backend, chosen.address) == (3, "processes", None)
    before = type(joblib.parallel.get_active_backend()[0])
    with workers(chosen):
        assert type(joblib.parallel.get_active_backend()[0]) is before


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["--backend", "rey"], "--backend is 'rey', expected one of 'processes', 'ray'; did you mean 'ray'"),
        (["--address", "auto"], "--address is 'auto', expected it with --backend ray only"),
    ],
)
def test_mistakes_name_what_was_expected(given, words):
    with pytest.raises(InputError, match=words), workers(options(*given)):
        pytest.fail("the work began")


@pytest.mark.skipif(importlib.util.find_spec("ray") is not None, reason="Ray is installed")
def test_without_ray_the_extra_is_named():
    with (
        pytest.raises(InputError, match=r"needs Ray.*pip install 'wavegym\[ray\]'"),
        workers(options("--backend", "ray")),
    ):
        pytest.fail("the work began")
