"""The gallery of managers in Stone Soup, in short: the table, the ranking, the scenario."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
import pytest

from wavegym.core.errors import InputWarning

EXAMPLE = Path(__file__).parents[3] / "examples" / "stonesoup"


@pytest.fixture(scope="module")
def gallery():
    sys.path.insert(0, str(EXAMPLE))
    import waveform_gallery

    yield waveform_gallery
    sys.path.remove(str(EXAMPLE))
    del sys.modules["waveform_gallery"]


@pytest.mark.slow
def test_the_table_of_a_short_run(gallery, tmp_path, capsys):
    out = tmp_path / "folder" / "gallery.csv"
    with pytest.warns(InputWarning, match="horizon=6"):
        table = gallery.main(["--seeds", "3", "--horizon", "6", "--out", str(out)])
    assert table in capsys.readouterr().out
    rows = list(csv.DictReader(out.open()))
    assert len(rows) == 3 * len(gallery.MANAGERS)
    trace = {name: [float(r["trace"]) for r in rows if r["manager"] == name] for name in gallery.MANAGERS}
    assert min(trace["random"]) > 2.0 * max(trace["myopic"])
    np.testing.assert_allclose(trace["brute force, trace"], trace["myopic"], rtol=1e-6)
    lines = table.splitlines()
    assert "3 paired seeds" in lines[0]
    assert [line.split(" | ")[0].strip("| ") for line in lines[2:]] == list(gallery.MANAGERS)
    assert f"{np.mean(trace['ppo']):.1f} [" in lines[2]


def test_the_table_takes_the_seeds_that_all_have_played(gallery):
    rows = [
        {"seed": seed, "manager": name, "trace": float(seed), "squared_error": 1.0, "seconds": 0.001}
        for name, seeds in (("ppo", 4), ("myopic", 2))
        for seed in range(seeds)
    ]
    table = gallery.table(rows)
    assert "2 paired seeds" in table
    assert "| ppo | 0.5 [" in table


def test_the_scenario_is_that_of_the_environment(gallery):
    """Over many seeds: bounds of the start, and steps with the covariance of the motion model."""
    system = gallery.PolicySensorManager(env=gallery.ENV).system
    starts, steps, ratios = [], [], []
    for seed in range(60):
        path, track = gallery.scenario(system, seed)
        states = np.array([np.ravel(state.state_vector) for state in path], float)
        starts.append(states[0])
        steps.append(states[1:] - states[:-1] @ system.motion.F.T)
        ratios.append((np.ravel(track.mean) - states[0]) ** 2 / np.diagonal(track.covar))
        assert len(states) == system.horizon + 1
    low, high = np.array([system.start_range, system.start_speed]).T
    assert (np.array(starts) >= low).all()
    assert (np.array(starts) <= high).all()
    np.testing.assert_allclose(np.cov(np.concatenate(steps).T), system.motion.Q, rtol=0.1)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.35)
