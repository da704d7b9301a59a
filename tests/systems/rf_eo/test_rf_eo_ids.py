"""The RF/EO environments by id: conformance, observations, info, and what they refuse."""

from __future__ import annotations

import math
from functools import partial

import gymnasium as gym
import mistakes
import numpy as np
import oracles
import pytest
import rf_eo_oracle as plain
from gymnasium.utils.env_checker import check_env

import evaluate
from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.envs import WaveformVectorEnv
from wavegym.systems.rf_eo.system import RfEo, RfEoFar
from wavegym.testing import check_vector_env

IDS = ("wavegym/RfEo-v0", "wavegym/RfEoFar-v0")
FORMS = ("library", "joint", "box")
NAN, INF = math.nan, math.inf


@pytest.mark.parametrize("action", FORMS)
@pytest.mark.parametrize("id", IDS)
def test_registered_in_all_forms(id, action):
    """Gymnasium's own check passes; a batch equals single environments; truncated at the horizon, never terminated."""
    settings = {"action": action, "horizon": 7}
    check_env(gym.make(id, disable_env_checker=True, **settings).unwrapped, skip_render_check=True)
    single, batch = gym.make(id, **settings), gym.make_vec(id, 3, **settings)
    for k, one, many in oracles.in_step(single, batch, 7):
        assert one[2:4] == (False, k == 7)
        for name in ("position_error", "nees", "lost", "received", "information", "below_threshold"):
            np.testing.assert_array_equal(one[4][name], many[4][name][0])


@pytest.mark.parametrize("system", [*(RfEo(horizon=6, action=form) for form in FORMS), RfEoFar(horizon=6)])
def test_does_what_gymnasiums_vector_environment_does(system):
    assert check_vector_env(partial(WaveformVectorEnv, system)) is None


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


BAD = [
    ({"prf": (1e5, 1e3)}, r"prf is \(100000, 1000\), expected \(low, high\); nearest: \(1000, 100000\)"),
    ({"bandwidth": (2e7, 1e6)}, r"bandwidth is .*nearest: \(1e\+06, 2e\+07\)"),
    ({"pixel_angle": (1e-3, 1e-5)}, r"pixel_angle is .*nearest: \(1e-05, 0.001\)"),
    ({"prf": (1e4, 1e4)}, "expected low < high"),
    ({"prf": (0.0, 1e5)}, "prf.0 is 0.0 Hz, expected a finite number > 0"),
    ({"prf": (-1e3, 1e5)}, "prf.0 is -1000.0 Hz"),
    ({"bandwidth": (0.0, 1e6)}, "bandwidth.0 is 0.0 Hz"),
    ({"bandwidth": (-1.0, 1e6)}, "bandwidth.0 is -1.0 Hz"),
    ({"pixel_angle": (0.0, 1e-3)}, "pixel_angle.0 is 0.0 rad"),
    ({"prf": (1e4, INF)}, "prf.1 is inf Hz, expected a finite number"),
    ({"prf": (NAN, 1e4)}, "prf.0 is nan Hz, expected a finite number"),
    ({"prf": (1e4,)}, "prf is .*expected 2 elements, not 1"),
    ({"fft_length": 2048}, r"dwell of 2048 pulses at 1000 Hz is 2.048 s, expected at most dt = 1 s .*prf: 2048 Hz"),
    ({"dt": 0.1}, "dwell of 128 pulses .*nearest prf: 1280 Hz"),
    ({"dt": 1e300}, "dt is 1e.300 s, expected a finite number <= 1e.06 .nearest: 1e.06"),
    ({"q": 1e300}, "q is 1e.300 m.2/s.3, expected a finite number <= 1e.12 .nearest: 1e.12"),
    ({"bandwidth": (1e6, 1e301)}, "bandwidth.1 is 1e.301 Hz, expected a finite number <= 1e.12 .nearest: 1e.12"),
    ({"platforms": ((0.0, 1e300),)}, "platforms.0.1 is 1e.300 m, expected .*nearest: 1e.09"),
    ({"prior_variance": (1e20, 25.0, 1e20, 25.0)}, r"prior_variance is up to 1e.20, expected at most 1e.12 times"),
    ({"pixel_angle": (1e-5, 1e-2)}, "high of pixel_angle is 0.01 rad.*nearest: 0.00628319"),
    ({"pixels": 2000}, "high of pixel_angle is 0.00628319 rad.*nearest: 0.00314159"),
    ({"pixels": 0}, "pixels is 0, expected an integer >= 1 .nearest: 1"),
    ({"pixels": 2.5}, "pixels is 2.5.*integer"),
    ({"fft_length": 0}, "fft_length is 0"),
    ({"dt": 0.0}, "dt is 0.0"),
    ({"dt": NAN}, "dt is nan"),
    ({"q": -1.0}, r"q is -1.0 m\^2/s\^3, expected a finite number >= 0 \(nearest: 0\)"),
    ({"q": INF}, "q is inf"),
    ({"carrier_hz": 0.0}, "carrier_hz is 0.0"),
    ({"horizon": 0}, "horizon is 0"),
    ({"iterations": 0}, "iterations is 0"),
    ({"platforms": ()}, "number of platforms is 0"),
    ({"starts": ()}, "number of starts is 0"),
    ({"platforms": ((0.0, 0.0),) * 65}, r"number of platforms is 65.*nearest: 64"),
    ({"starts": ((0.0,) * 4,) * 65}, r"number of starts is 65.*nearest: 64"),
    ({"platforms": ((0.0, NAN),)}, "platforms.0.1 is nan m, expected a finite number"),
    ({"starts": ((0.0, INF, 0.0, 0.0),)}, "starts.0.1 is inf, expected a finite number"),
    ({"starts": ((0.0,) * 3,)}, "starts.0 is .*expected 4 elements, not 3"),
    ({"looks": (0.0,)}, r"looks is \(0.0,\), expected 2 angles, one for each platform"),
    ({"looks": (0.0, 4.0)}, "looks.1 is 4.0 rad.*nearest: 3.14159"),
    ({"looks": (0.0, NAN)}, "looks.1 is nan rad"),
    ({"weights": (1.0, -1.0, 1.0, 1.0)}, "weights.1 is -1.0, expected a finite number >= 0"),
    ({"weights": (0.0,) * 4}, "sum of weights is 0.0"),
    ({"weights": (NAN, 1.0, 1.0, 1.0)}, "weights.0 is nan"),
    ({"weights": (1.0, 1.0)}, "weights is .*expected 4 elements, not 2"),
    ({"weights": np.diag([1.0, 1.0, 1.0, -2.0])}, r"weights has the eigenvalue -2, .* \(nearest eigenvalue: 0\)"),
    (
        {"weights": np.eye(4) + np.eye(4, k=1)},
        r"weights has \[0, 1\] = 1 and \[1, 0\] = 0, expected a symmetric matrix",
    ),
    ({"weights": np.eye(3)}, r"weights has rows of \[3, 3, 3\] elements, expected 4 numbers, or 4 rows of 4"),
    ({"weights": np.zeros((4, 4))}, "sum of weights is 0.0"),
    ({"prior_variance": (0.0, 1.0, 1.0, 1.0)}, "prior_variance.0 is 0.0, expected a finite number > 0"),
    ({"height": (-1.0, 1.0, 1.0)}, "height.0 is -1.0, expected a finite number >= 0"),
    ({"sharpness": (0.0, 1.0, 1.0)}, "sharpness.0 is 0.0, expected a finite number > 0"),
    ({"sharpness": (1.0, 1.0)}, "sharpness is .*expected 3 elements, not 2"),
    ({"margin": -1.0}, "margin is -1.0"),
    ({"threshold": -0.5}, "threshold is -0.5"),
    ({"threshold": NAN}, "threshold is nan"),
    ({"nearest_range": 0.0}, "nearest_range is 0.0"),
    ({"penalty": "logistc"}, "penalty is 'logistc'.*'logistic'"),
    ({"out_of_view": "mising"}, "out_of_view is 'mising'.*'missing'"),
    ({"first_estimate": "half"}, "first_estimate is 'half'.*'halfway'"),
    ({"action": "boxx"}, "action is 'boxx'.*'box'"),
    ({"points": (0, 1, 4)}, "points of prf is 0"),
    ({"points": (4, 1)}, "points is .*expected 3 elements, not 2"),
    ({"points": (10**6, 10**6, 4)}, "library has 4000000000000 settings, of points .*, expected at most 65536"),
    ({"action": "joint", "platforms": ((0.0, 0.0),) * 8}, r"joint actions are 16\^8.*nearest action: 'library'"),
    ({"horizen": 50}, "did you mean 'horizon'"),
    ({"births": (0,)}, r"births is \(0,\), expected 2 steps, one for each of starts"),
    ({"births": (0, 1000)}, "greatest of births is 1000.*nearest: 999"),
    ({"births": (0, -1)}, "births.1 is -1"),
    ({"lifetime": 0}, "lifetime is 0"),
    ({"turns": 4}, r"turns is 4, expected an odd number.*nearest: 5"),
    ({"slew_rate": -1.0}, r"slew_rate is -1.* rad/s, expected"),
    (
        {"action": "joint", "points": (8, 1, 8), "slew_rate": 1.0},
        r"joint actions are 320\^2, of points \(8, 1, 8\) with 5 turns.*nearest action: 'library'",
    ),
    (
        {"points": (200, 1, 200), "turns": 3, "slew_rate": 1.0},
        r"120000 settings, of points \(200, 1, 200\) with 3 turns",
    ),
]


@pytest.mark.parametrize(("parameters", "words"), BAD)
def test_bad_input_is_refused_in_one_line(parameters, words):
    with pytest.raises(InputError, match=words) as caught:
        gym.make("wavegym/RfEo-v0", **parameters)
    assert "\n" not in str(caught.value)


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
