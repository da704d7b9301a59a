"""Evaluation, the ladder and tuning on a Ray cluster: the same numbers, to the last bit, as on this machine."""

from __future__ import annotations

import json

import numpy as np
import pytest

from wavegym.cli import evaluate
from wavegym.core.errors import InputError
from wavegym.evaluation import compare, headroom

ray = pytest.importorskip("ray", reason="Ray is not installed: make test-oldest has it")

from wavegym.integrations.ray import cluster  # noqa: E402

WORLDS = 60  # more than a batch of worlds: two tasks for each policy


@pytest.mark.parametrize("address", ["auto", "127.0.0.1:9", "ray://127.0.0.1:9", "127.0.0.1:port"])
def test_a_cluster_that_does_not_answer_is_one_line(address):
    wanted = f"no Ray cluster answers at '{address}', expected its address"
    with pytest.raises(InputError, match=wanted), cluster(address):
        pytest.fail("the work began")


def test_the_commands_write_the_same_episodes(tmp_path):
    given = ["KershawEvansPosition-v0", "--policies", "myopic,random", "--worlds", "60", "--jobs", "2"]
    assert evaluate.main([*given, "--backend", "ray", "--out", str(tmp_path / "ray")]) == 0
    assert evaluate.main([*given, "--out", str(tmp_path / "here")]) == 0
    ray_text, text = ((tmp_path / name / "episodes.csv").read_text() for name in ("ray", "here"))
    assert ray_text == text
    assert not ray.is_initialized()  # the cluster of the command has ended


def test_the_ladder_is_that_of_this_machine(tmp_path):
    rows = []
    for backend in ("ray", "processes"):
        out = tmp_path / backend
        where = ["--jobs", "2", "--backend", backend, "--out", str(out)]
        headroom.main(["wavegym/KershawEvans-v0", "--worlds", "5", *where])
        policies = json.loads((out / "KershawEvans-v0.json").read_text())["policies"]
        rows.append({name: {k: v for k, v in row.items() if k != "us_per_decision"} for name, row in policies.items()})
    assert rows[0] == rows[1]


@pytest.fixture(scope="module")
def two_workers():
    """A cluster of this machine. It comes after the tests that start one of their own."""
    ray.init(address="local", num_cpus=2, include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


@pytest.mark.parametrize(
    ("env_id", "policies"),
    [
        ("wavegym/KershawEvansPosition-v0", ["random", "ppo", "lookahead:2"]),
        ("wavegym/EnergyBudgetKnown-v0", ["random", "best-simple", "ppo"]),
    ],
)
def test_a_comparison_is_that_of_this_machine(two_workers, env_id, policies):
    with cluster():
        found = compare(env_id, policies, worlds=WORLDS, progress=False)
    assert ray.is_initialized()
    here = compare(env_id, policies, worlds=WORLDS, jobs=2, progress=False)
    for name in (*policies, "myopic"):
        assert found.cost(name).shape[1] == WORLDS
        np.testing.assert_array_equal(found.cost(name), here.cost(name), strict=True)


@pytest.mark.slow
def test_trials_of_a_search_run_on_ray(two_workers, tmp_path):
    pytest.importorskip("optuna")
    from runs_for_tests import ID, SMALL

    from wavegym.learning.hyperparameters import tune

    with cluster():
        tune(ID, "ppo", 3, 0, SMALL["ppo"], {"horizon": 7}, tmp_path, jobs=2)
    assert len((tmp_path / "trials.csv").read_text().splitlines()) == 1 + 3
