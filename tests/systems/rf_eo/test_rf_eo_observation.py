"""What RF/EO platforms observe, and the flag of a threshold out of reach."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import oracles
import pytest
import rf_eo_oracle as plain

from wavegym.core import shortcuts
from wavegym.systems.rf_eo.system import RfEo


@pytest.mark.parametrize(("platforms", "targets", "count"), [(1, 1, 8), (2, 2, 28), (3, 1, 20), (2, 3, 42), (3, 3, 60)])
def test_every_element_of_the_observation_is_as_documented(platforms, targets, count):
    system = RfEo(
        horizon=4, first_estimate="drawn", platforms=((-1e3, -1e3), (1e3, -1e3), (0.0, 3e3))[:platforms],
        starts=((-1e3, 20.0, 1e3, 0.0), (1e3, 0.0, 1e3, 30.0), (0.0, 5.0, -3e3, 5.0))[:targets],
        looks=(0.4, -2.0, 3.1)[:platforms]
    )  # fmt: skip
    worlds = oracles.worlds(system, 2)
    state = system.initial(worlds)
    for _ in range(3):
        state = system.transition(state, shortcuts.best_action(system, state.belief), worlds)
        want = {}
        for t in range(targets):
            x, P = plain.predict(system, state.belief.mean[1, t], state.belief.covariance[1, t])
            want[f"log10_sigma_position_{t + 1}"] = np.log10(np.sqrt(P[0, 0] + P[2, 2]))
            want[f"log10_sigma_velocity_{t + 1}"] = np.log10(np.sqrt(P[1, 1] + P[3, 3]))
            h, C = plain.stacked(system, x)
            for j in range(platforms):
                sigma = np.sqrt(np.diag(C[j] @ P @ C[j].T))
                short = {"range": "r", "range_rate": "rdot", "azimuth": "az"}
                for q, (name, spread) in enumerate(short.items()):
                    want[f"log10_{name}_{t + 1}_{j + 1}"] = np.log10(abs(h[j, q]))
                    want[f"log10_sigma_{spread}_{t + 1}_{j + 1}"] = np.log10(sigma[q])
        assert [element.name for element in system.observation_fields] == list(want)
        assert len(want) == count
        np.testing.assert_allclose(system.observe(state.belief)[1], list(want.values()), rtol=1e-7, atol=1e-7)


def test_a_threshold_out_of_reach_is_flagged_in_info():
    for threshold, flagged in ((0.0, False), (1e30, True)):
        env = gym.make("wavegym/RfEo-v0", threshold=threshold, horizon=2)
        _, info = env.reset(seed=0)
        assert not info["below_threshold"]
        *_, info = env.step(env.action_space.sample())
        assert info["below_threshold"] == flagged
        assert (info["information"] >= threshold) == (not flagged)
