"""check_vector_env accepts the suite and names the defect of environments broken on purpose."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from small_systems import BRIEF, Burner, Leaky, LeakyMetric

import wavegym
from wavegym.core.errors import InputError
from wavegym.envs import WaveformEnv, WaveformVectorEnv
from wavegym.systems.kershaw_evans.system import KershawEvansPosition
from wavegym.testing import check_vector_env
from wavegym.testing.check import ConformanceError
from wavegym.testing.lockstep import difference

SYSTEM = "wavegym.systems.kershaw_evans.system:KershawEvansPosition"


class LosesTerminalObservation(WaveformVectorEnv):
    """SAME_STEP: final_obs is the first observation of the next episode."""

    def step(self, actions):
        observations, reward, terminated, truncated, info = super().step(actions)
        for i in np.flatnonzero(info.get("_final_obs", ())):
            info["final_obs"][i] = observations[i].copy()
        return observations, reward, terminated, truncated, info


class DropsTerminalObservation(WaveformVectorEnv):
    """SAME_STEP: no final_obs at all."""

    def step(self, actions):
        *rest, info = super().step(actions)
        info.pop("final_obs", None)
        info.pop("_final_obs", None)
        return *rest, info


class ShowsNextEpisodeEarly(WaveformVectorEnv):
    """NEXT_STEP: the last observation is replaced by another one."""

    def step(self, actions):
        observations, reward, terminated, truncated, info = super().step(actions)
        observations[terminated | truncated] = 0.0
        return observations, reward, terminated, truncated, info


class LosesTruncation(WaveformVectorEnv):
    """Reports no truncation."""

    def step(self, actions):
        observations, reward, terminated, truncated, info = super().step(actions)
        return observations, reward, terminated, np.zeros_like(truncated), info


class IgnoresTimeLimit(WaveformVectorEnv):
    """max_episode_steps is not applied: gym.make_vec adds no TimeLimit."""

    def __init__(self, *arguments, max_episode_steps=None, **settings):
        super().__init__(*arguments, **settings)


class LosesAStep(WaveformVectorEnv):
    """NEXT_STEP: while one environment is reset the others stand still."""

    def step(self, actions):
        ended, observations = self._ended.copy(), self.episodes.observe()[0]
        if self.autoreset_mode.value == "NextStep" and ended.any():
            observations, info = self.reset(options={"reset_mask": ended})
            return observations, np.zeros(self.num_envs), np.zeros_like(ended), np.zeros_like(ended), info
        return super().step(actions)


class PopsResetMask(WaveformVectorEnv):
    """Takes the mask out of the caller's options."""

    def reset(self, *, seed=None, options=None):
        mask = options.pop("reset_mask", None) if options else None
        return super().reset(seed=seed, options=None if mask is None else {"reset_mask": mask})


class ChangesResetMask(WaveformVectorEnv):
    """Writes into the caller's mask."""

    def reset(self, *, seed=None, options=None):
        result = super().reset(seed=seed, options=options)
        if options:
            options["reset_mask"][:] = False
        return result


class ResetsEverything(WaveformVectorEnv):
    """Ignores the mask."""

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed)


class ReusesBuffers(WaveformVectorEnv):
    """Returns one and the same observation array."""

    def step(self, actions):
        observations, *rest = super().step(actions)
        if not hasattr(self, "buffer"):
            self.buffer = observations
        self.buffer[:] = observations
        return self.buffer, *rest


class CannotBePickled(WaveformVectorEnv):
    """Holds on to a function of its own."""

    def step(self, actions):
        self.callback = lambda: None
        return super().step(actions)


class ForgetsItsGenerators(WaveformVectorEnv):
    """An unpickled copy draws other worlds."""

    def __setstate__(self, state):
        self.__dict__.update(state)
        self.episodes.generators = [np.random.default_rng(i) for i in range(self.num_envs)]


class NamesModeByString(WaveformVectorEnv):
    """metadata["autoreset_mode"] is not the enum."""

    def __init__(self, *arguments, **settings):
        super().__init__(*arguments, **settings)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode.value}


class MislabelsInfo(WaveformVectorEnv):
    """Info lacks a mask."""

    def step(self, actions):
        *rest, info = super().step(actions)
        info.pop("_waveform", None)
        return *rest, info


class ChangesActions(WaveformVectorEnv):
    def step(self, actions):
        stepped = super().step(actions)
        actions[...] = 0
        return stepped


class ClosesOnce(WaveformVectorEnv):
    """Its second close raises."""

    is_closed = False

    def close(self, **kwargs):
        if self.is_closed:
            raise RuntimeError("closed already")
        self.is_closed = True


class CountsTheFirstSeedOnly(WaveformVectorEnv):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed[0] if isinstance(seed, list) else seed, options=options)


class IgnoresOddSeeds(WaveformVectorEnv):
    """Goes on with its generators."""

    def reset(self, *, seed=None, options=None):
        is_odd = isinstance(seed, int) and seed % 2 and self.num_envs > 1
        return super().reset(seed=None if is_odd else seed, options=options)


class LeavesItsSpaceRarely(WaveformVectorEnv):
    """In one of a hundred steps of an environment, a long way into an episode."""

    def step(self, actions):
        observations, *rest = super().step(actions)
        if self.num_envs > 3 and self.episodes.state.belief.step[0] == 3:
            observations[5, 0] = 99.0
        return observations, *rest


BROKEN = {
    ChangesActions: r"actions changed: after step\(\) the caller's actions",
    ClosesOnce: r"a second close\(\) raised RuntimeError: closed already",
    CountsTheFirstSeedOnly: "seed ignored|as from single environments",
    IgnoresOddSeeds: "seed ignored|as from single environments",
    LeavesItsSpaceRarely: "observations are outside observation_space",
    LosesTerminalObservation: r"terminal observation lost: info\['final_obs'\]\[\d\] is the first one of the next",
    DropsTerminalObservation: r"terminal observation lost: environment \d ended, but info\['final_obs'\]\[\d\] is m",
    ShowsNextEpisodeEarly: "terminal observation lost: environment 0 ended, but this is not its last observation",
    LosesTruncation: "truncation lost: environment 0 was cut off by its time limit, but truncated is False",
    IgnoresTimeLimit: "truncation lost: environment 0 was cut off by its time limit, but truncated is False",
    LosesAStep: r"step lost: environment \d stood still while environments \[\d(, \d)?\] were reset",
    PopsResetMask: "reset mask popped: reset\\(\\) removed 'reset_mask' from the caller's options",
    ChangesResetMask: "reset mask changed",
    ResetsEverything: r"a partial reset changed environment \d, which is not in options\['reset_mask'\]",
    ReusesBuffers: r"buffers reused: what (step \d+|reset\(\)) returned was overwritten later",
    CannotBePickled: "pickling in mid-episode raised",
    ForgetsItsGenerators: "after pickling",
    NamesModeByString: "metadata\\['autoreset_mode'\\] is 'NextStep', expected the enum AutoresetMode.NEXT_STEP",
    MislabelsInfo: "info lacks the key '_waveform'",
}


@pytest.mark.slow
@pytest.mark.parametrize("id", wavegym.list_envs())
def test_every_environment_of_the_suite_passes(id):
    assert check_vector_env(id, **BRIEF.get(id, {})) is None


@pytest.mark.parametrize("action", ["library", "box"])
def test_a_factory_passes_and_its_time_limit_is_compared_with_gymnasiums(action):
    def factory(num_envs, autoreset_mode, max_episode_steps=None):
        settings = {"autoreset_mode": autoreset_mode, "max_episode_steps": max_episode_steps}
        return WaveformVectorEnv(KershawEvansPosition(horizon=6, action=action), num_envs, **settings)

    assert check_vector_env(factory) is None


def test_settings_are_for_ids():
    with pytest.raises(InputError, match="expected none: only an id takes any"):
        check_vector_env(LosesAStep, horizon=6)


@pytest.fixture
def broken(request):
    id = f"tests/{request.param.__name__}-v0"
    settings = {"system": SYSTEM, "horizon": 6}
    gym.register(id, entry_point=WaveformEnv, vector_entry_point=request.param, kwargs=settings)
    yield id, BROKEN[request.param]
    del gym.registry[id]


@pytest.mark.filterwarnings("ignore:.*AutoresetMode:UserWarning")
@pytest.mark.parametrize("broken", list(BROKEN), indirect=True, ids=lambda cls: cls.__name__)
def test_a_broken_environment_is_rejected_by_name_of_its_defect(broken):
    id, defect = broken
    with pytest.raises(ConformanceError, match=defect) as caught:
        check_vector_env(id)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{id}, num_envs=")
    assert isinstance(caught.value, AssertionError)


@pytest.mark.parametrize("cls", [LosesTerminalObservation, LosesAStep, PopsResetMask, LosesTruncation])
def test_a_broken_factory_is_rejected_too(cls):
    def factory(num_envs, autoreset_mode, max_episode_steps=None):
        settings = {"autoreset_mode": autoreset_mode, "max_episode_steps": max_episode_steps}
        return cls(KershawEvansPosition(horizon=6), num_envs, **settings)

    with pytest.raises(ConformanceError, match=BROKEN[cls]):
        check_vector_env(factory)


@pytest.mark.parametrize(
    ("system", "defect"),
    [(Burner, None), (Leaky, "state exposed, as writing into"), (LeakyMetric, "state exposed, as writing into")],
)
def test_a_system_that_hands_out_its_state_is_rejected(system, defect):
    def factory(num_envs, autoreset_mode):
        return WaveformVectorEnv(system, num_envs, autoreset_mode=autoreset_mode)

    found = report(factory)
    assert found.startswith(defect) if defect else not found


def report(env):
    """The defect that the check reports, or ""."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            check_vector_env(env, max_steps=100)
        except ConformanceError as defect:
            return str(defect)
    return ""


def test_gymnasiums_own_environments_are_judged_in_at_most_one_line():
    def sync_vector_env(num_envs, autoreset_mode):
        singles = [lambda: gym.make("CartPole-v1")] * num_envs
        return gym.vector.SyncVectorEnv(singles, autoreset_mode=autoreset_mode)

    reports = [report("CartPole-v1"), report(sync_vector_env)]
    print(*reports, sep="\n")  # theirs to mend, so what it is does not matter here
    assert all("\n" not in text for text in reports)


NAN = np.array([1.0, np.nan])


@pytest.mark.parametrize(
    ("got", "want", "words"),
    [
        (NAN, NAN.copy(), None),
        (np.array([0.0]), np.array([-0.0]), f"[0] is {np.float64(0.0)!r}, expected {np.float64(-0.0)!r}"),
        (np.zeros(2, np.float32), np.zeros(2), " is float32 with shape (2,), expected float64 with shape (2,)"),
        (np.zeros((2, 1)), np.zeros(2), " is float64 with shape (2, 1), expected float64 with shape (2,)"),
        ({"a": 1}, {"a": 1, "b": 2}, " lacks the key 'b'"),
        ({"a": 1, "b": 2}, {"a": 1}, " has the key 'b', which is not expected"),
        (
            {"a": {"b": np.array([1, 2])}},
            {"a": {"b": np.array([1, 3])}},
            f"['a']['b'][1] is {np.int64(2)!r}, expected {np.int64(3)!r}",
        ),
        (np.array([None, NAN], object), np.array([None, NAN.copy()], object), None),
        (np.array([None, NAN], object), np.array([NAN, None], object), "[0] is None, expected array([ 1., nan])"),
        ((1, 2), (1, 2, 3), " is (1, 2), expected a tuple of 3"),
        ((1, "x"), (1, "y"), "[1] is 'x', expected 'y'"),
        (np.array([1 + 1j]), np.array([1 + 1j]), None),
        (True, 1, " is bool with shape (), expected int64 with shape ()"),
    ],
)
def test_difference_says_where_and_how(got, want, words):
    assert difference(got, want) == words
