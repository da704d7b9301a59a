"""The RF/EO environments by id: observations, info, numbers of platforms, mistakes on the command line."""

from __future__ import annotations

import gymnasium as gym
import mistakes
import numpy as np
import oracles
import pytest
import rf_eo_oracle as plain

import evaluate
from wavegym.systems.rf_eo.system import RfEo

FORMS = ("library", "joint", "box")


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
        state = system.transition(state, system.best_action(state.belief), worlds)
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


@pytest.mark.parametrize("action", FORMS)
@pytest.mark.parametrize("targets", [1, 3])
@pytest.mark.parametrize("platforms", [1, 3])
def test_any_number_of_platforms_and_targets(platforms, targets, action):
    settings = {
        "platforms": ((-1e3, -1e3), (1e3, -1e3), (0.0, 5e3))[:platforms],
        "starts": ((0.0, 1.0, 2e3, 3.0), (500.0, 0.0, 900.0, 0.0), (1.0, 2.0, 3.0, 4.0))[:targets],
        "points": (2, 1, 2), "action": action, "horizon": 3
    }  # fmt: skip
    env = gym.make("wavegym/RfEo-v0", **settings)
    seen, _ = env.reset(seed=1)
    shapes = {"box": (3 * platforms,), "library": (platforms,), "joint": ()}
    assert env.action_space.shape == shapes[action]
    for _ in range(3):
        seen, reward, *_, info = env.step(env.action_space.sample())
        assert seen.shape == (targets * (2 + 6 * platforms),)
        assert np.isfinite(seen).all()
        assert np.isfinite(reward)
        assert info["received"].shape == (targets,)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ("prf=1e5,1e3", "nearest: (1000, 100000)"),
        ("bandwidth=0,1e6", "bandwidth.0 is 0"),
        ("fft_length=2048", "dwell of 2048 pulses"),
        ("weights=1,-1,1,1", "weights.1 is -1"),
        ("pixel_angle=1e-5,1e-2", "nearest: 0.00628319"),
        ("penalty=logistc", "penalty is 'logistc'"),
        ("platform=0,0", "did you mean 'platforms'"),
    ],
)
def test_on_the_command_line_too(tmp_path, capsys, settings, words):
    command = ["RfEo-v0", "--out", str(tmp_path), "--worlds", "3", "--jobs", "1", "--set", "horizon=4", settings]
    mistakes.costs_one_line_and_no_earlier_result(lambda: evaluate.main(command), tmp_path, capsys, words)
