"""Trackers of other packages in a Kershaw-Evans loop: the same worlds, the same costs, the shipped agent."""

from __future__ import annotations

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from wavegym.core.action_sets import Library
from wavegym.core.errors import InputError
from wavegym.evaluation import compare
from wavegym.systems.kershaw_evans.system import KershawEvans
from wavegym.testing.capability_check import capability_defect
from wavegym.waveforms import TrapezoidChirp

EXAMPLE = Path(__file__).parents[1] / "examples" / "own_parts"
ID, WORLDS = "wavegym/KershawEvansPosition-v0", 10


@pytest.fixture(scope="module", autouse=True)
def _on_the_path():
    sys.path.insert(0, str(EXAMPLE))
    yield
    sys.path.remove(str(EXAMPLE))


@pytest.fixture(scope="module")
def plain():
    return compare(ID, ["myopic", "ppo"], worlds=WORLDS, jobs=1)


@pytest.mark.filterwarnings("ignore:.*parameters that differ")
@pytest.mark.parametrize("name", ["filterpy_ekf", "filterpy_ukf", "stonesoup_kalman"])
def test_the_filters_of_other_packages_cost_the_same(plain, name) -> None:
    """The loop is linear, so all are the Kalman filter: only rounding differs. The agent keeps its gain."""
    other = compare(ID, ["myopic", "ppo"], worlds=WORLDS, jobs=1, tracker=f"own_parts.trackers:{name}")
    for policy in ("myopic", "ppo"):
        np.testing.assert_allclose(other.cost(policy), plain.cost(policy), rtol=1e-8)
    assert other.cost("ppo").mean() < 0.9 * other.cost("myopic").mean()


@pytest.mark.filterwarnings("ignore:.*parameters that differ")
def test_a_tracker_of_ones_own_costs_more(plain) -> None:
    """It forgets, so its covariance stays larger than the Kalman filter's, which is the least."""
    from own_parts.trackers import FadingMemory

    other = compare(ID, ["myopic", "ppo"], worlds=WORLDS, jobs=1, tracker=FadingMemory(1.2))
    assert (other.cost("myopic") > plain.cost("myopic")).all()
    assert other.cost("ppo").mean() < other.cost("myopic").mean()
    np.testing.assert_allclose(
        compare(ID, ["myopic"], worlds=WORLDS, jobs=1, tracker=FadingMemory(1.0)).cost("myopic"),
        plain.cost("myopic"),
        rtol=1e-8,
    )


def test_a_tracker_of_ones_own_passes_the_check_of_capabilities() -> None:
    assert capability_defect(KershawEvans(tracker="own_parts.trackers:filterpy_ekf", horizon=6)) is None


def test_what_is_no_tracker_is_refused() -> None:
    with pytest.raises(InputError, match="tracker is 5, expected an object with predict"):
        gym.make(ID, tracker=5)


def test_pulses_of_ones_own() -> None:
    """A library of generalised chirps in place of Gaussian ones; schedulers try these."""
    pulses = tuple(TrapezoidChirp(kind=kind, duration=100e-6, sweep=1e6) for kind in ("lfm", "hfm", "efm"))
    env = gym.make_vec("wavegym/KershawEvans-v0", num_envs=2, library=Library(pulses))
    assert env.single_action_space.n == 3
    assert env.unwrapped.system.actions.labels[1] == pulses[1].label
    comparison = compare(
        "wavegym/KershawEvans-v0", ["lookahead:2"], worlds=3, jobs=1, library=Library(pulses), horizon=5
    )
    assert np.isfinite(comparison.cost("lookahead:2")).all()


def test_pulses_of_ones_own_span_no_box() -> None:
    with pytest.raises(InputError, match="library is given with action='box', expected action='library'"):
        gym.make("wavegym/KershawEvans-v0", action="box", library=Library(("a",)))
