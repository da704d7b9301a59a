"""The observation without a belief: measurements of the sensors, and nothing from a tracker."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import oracles
import pytest

from wavegym.core.errors import InputError
from wavegym.evaluation import compare, make_task
from wavegym.observations.observer import MeasurementObserver

OFFERING = (
    "KershawEvans-v0",
    "KershawEvansPosition-v0",
    "RfEo-v0",
    "RfEoFar-v0",
    "CameraSlew-v0",
    "SectorSetup-v0",
    "SectorSetupCity-v0",
)


def played(env_id, steps, action=None, **settings):
    """Observations and infos of one action, or of drawn ones, axis 0 = step."""
    envs = gym.make_vec(f"wavegym/{env_id}", num_envs=4, observation="measurements", measurements=True, **settings)
    envs.action_space.seed(3)
    seen, infos = [envs.reset(seed=5)[0]], []
    for _ in range(steps):
        observation, *_, info = envs.step(envs.action_space.sample() if action is None else np.full(4, action))
        seen.append(observation)
        infos.append(info)
    return envs.unwrapped, np.stack(seen), infos


@pytest.mark.parametrize("env_id", OFFERING)
def test_every_field_is_named_and_most_are_not_saturated(env_id):
    envs, seen, infos = played(env_id, 20)
    fields = envs.episodes.observer.observation_fields
    assert seen.shape[2] == len(fields) == len({field.name for field in fields})
    assert np.mean([info["saturated"] for info in infos]) < 0.1
    assert (np.ptp(seen, axis=(0, 1))[0]) > 0.0  # the time goes on


@pytest.mark.parametrize(("key", "value"), [("tracker", "imm"), ("weights", (1.0, 1.0)), ("q", 3.0)])
def test_what_the_tracker_believes_is_not_shown(key, value):
    """Another tracker, cost or assumed process noise in the same world: another belief, the same observations."""
    same_world = {"truth": {"q": 100.0}} if key == "q" else {}
    (_, one, first), (_, two, second) = (
        played("KershawEvansPosition-v0", 15, **settings) for settings in ({}, {key: value, **same_world})
    )
    np.testing.assert_array_equal(one, two)
    assert any((a["cost"] != b["cost"]).all() for a, b in zip(first, second, strict=True))


def test_the_last_measurements_are_those_of_the_info():
    envs, seen, infos = played("KershawEvansPosition-v0", 10)
    fields = envs.episodes.observer.observation_fields
    centre, scale = (np.array([getattr(f, name) for f in fields[-2:]]) for name in ("centre", "scale"))
    for observation, info in zip(seen[1:], infos, strict=True):
        z = info["measured_z"]
        physical = np.stack([z[:, 0], np.sign(z[:, 1]) * np.log10(1 + abs(z[:, 1]))], axis=1)
        want = np.clip((physical - centre) / scale, -10, 10)
        np.testing.assert_allclose(observation[:, -2:], want, rtol=1e-6)
    np.testing.assert_array_equal(seen[0][:, -2:], 0.0)  # nothing was received yet


@pytest.mark.parametrize(
    ("env_id", "field", "flag"),
    [("CameraSlew-v0", "azimuth_1_1", "received_azimuth_1_1"), ("SectorSetup-v0", "rate_1", "detected_1")],
)
def test_what_was_not_received_has_the_centre_of_its_field_and_says_so(env_id, field, flag):
    envs, seen, _ = played(env_id, 40, action=0)
    names = [each.name for each in envs.episodes.observer.observation_fields]
    value, missed = seen[1:, :, names.index(field)], seen[1:, :, names.index(flag)] == -1.0
    assert 0.05 < missed.mean() < 0.95
    assert (value[missed] == 0.0).all()
    assert (value[~missed] != 0.0).all()


def test_the_last_action_is_shown_and_none_before_the_first():
    envs = gym.make_vec("wavegym/SectorSetup-v0", num_envs=3, observation="measurements")
    names = [field.name for field in envs.unwrapped.episodes.observer.observation_fields]
    sent = [i for i, name in enumerate(names) if name.startswith("sent_")]
    first, _ = envs.reset(seed=0)
    np.testing.assert_array_equal(first[:, sent], 0.0)
    observation, *_ = envs.step(np.array([0, 3, 5]))
    np.testing.assert_array_equal(observation[:, sent], np.eye(len(sent))[[0, 3, 5]])


@pytest.mark.parametrize("env_id", ["KershawEvansPosition-v0", "RfEoFar-v0", "SectorSetup-v0"])
def test_a_single_environment_is_a_batch_of_one(env_id):
    settings = {"observation": "measurements", "horizon": 6}
    single, batch = gym.make(f"wavegym/{env_id}", **settings), gym.make_vec(f"wavegym/{env_id}", 3, **settings)
    for _ in oracles.in_step(single, batch, 6):
        pass


def test_only_environments_that_begin_again_forget():
    envs = gym.make_vec("wavegym/KershawEvansPosition-v0", num_envs=3, observation="measurements")
    envs.reset(seed=0)
    observation, *_ = envs.step(np.array([1, 2, 3]))
    mask = np.array([False, True, False])
    again, _ = envs.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(again[~mask], observation[~mask])
    np.testing.assert_array_equal(again[mask][:, 1:], 0.0)


def test_policies_of_measurements_are_compared_in_their_own_task():
    def by_time(observation):
        return np.where(observation[:, 0] > 0.0, 3, 5)

    played = compare(
        "KershawEvansPosition-v0", {"by-time": by_time}, worlds=3, jobs=1, horizon=6, observation="measurements"
    )
    belief = compare("KershawEvansPosition-v0", {"myopic": None}, worlds=3, jobs=1, horizon=6)
    np.testing.assert_array_equal(played.cost("myopic"), belief.cost("myopic"))  # schedulers read the belief itself
    assert (played.cost("by-time") > played.cost("myopic")).all()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"observation": "measurement"}, "did you mean 'measurements'"),
        ({"observation": "measurements", "forecasts": True}, "forecasts is True with observation='measurements'"),
    ],
)
def test_other_observations_are_refused(settings, words):
    with pytest.raises(InputError, match=words):
        gym.make_vec("wavegym/KershawEvansPosition-v0", num_envs=2, **settings)


def test_a_system_that_does_not_offer_them_says_so():
    with pytest.raises(InputError, match=r"expected 'belief' \(nearest\): of AgileClutter, it has no measured_fields"):
        MeasurementObserver(make_task("AgileClutter-v0", {}).system)
