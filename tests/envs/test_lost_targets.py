"""Environments count the steps in which targets are astray, through resets, restarts and saved episodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from small_systems import Burner

from wavegym.envs import WaveformVectorEnv

FAR, NEAR = 5.0, 4.9  # m
ABSENT, DROPPED, ON_TRACK, OFF_TRACK, CONTRADICTED = ((0, 0, 0), (FAR, 0, 0), (NEAR, 18, 1), (FAR, 4, 1), (NEAR, 19, 1))
"""Position error, NEES (its 99.9 % quantile is 18.47) and whether the target has a track."""
STORY = np.array(
    [
        [ON_TRACK, *[OFF_TRACK] * 4, *[CONTRADICTED] * 3, ON_TRACK, OFF_TRACK, ON_TRACK],
        [DROPPED, DROPPED, ON_TRACK, DROPPED, OFF_TRACK, ABSENT, ABSENT, DROPPED, DROPPED, DROPPED, ABSENT],
    ]
)  # (target, step, figure), from step 0 on
LOST = [[5, 6, 7], [9, 10]]  # steps at which each target is lost


@dataclass(frozen=True)
class Story(Burner):
    """Two targets with the figures of the story, whatever the actions."""

    horizon: int = 10
    fuel: int = 100
    nees_dimension: ClassVar[int] = 4
    lost_beyond: ClassVar[float] = FAR

    def state_info(self, state):
        error, nees, tracked = np.moveaxis(STORY[:, state.belief.step], -1, 0)
        return {"position_error": error.T.copy(), "nees": nees.T.copy(), "present": tracked.T > 0}


def is_lost(step):
    """Whether each target is lost, of environments at these steps."""
    return [[s in lost for lost in LOST] for s in np.asarray(step).tolist()]


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_target_is_lost_after_five_steps_astray_in_every_episode(mode):
    env = WaveformVectorEnv(Story(), 2, autoreset_mode=mode)
    _, info = env.reset(seed=0)
    assert not info["lost"].any()
    assert info["astray"].tolist() == [[False, True]] * 2  # a target without a track, which it never had
    for k in range(1, 25):
        if k == 4:  # from here on environment 0 is behind
            _, info = env.reset(options={"reset_mask": np.array([True, False])})
            assert info["lost"][0].tolist() == [False, False]
        *_, info = env.step(np.zeros(2, np.int64))
        assert info["lost"].tolist() == is_lost(env.belief.step)
        if "final_info" in info:
            ended = info["_final_info"]
            assert info["final_info"]["lost"][ended].tolist() == is_lost([10] * ended.sum())


def test_the_count_goes_on_in_restored_episodes():
    first, other = (WaveformVectorEnv(Story(), 3) for _ in range(2))
    first.reset(seed=0)
    for _ in range(4):
        first.step(np.zeros(3, np.int64))
    other.restore(first.saved())
    *_, info = other.step(np.zeros(3, np.int64))
    assert info["lost"].tolist() == is_lost([5] * 3)


def test_threads_and_single_environments_count_alike():
    env, threaded = Story(), WaveformVectorEnv(Story(), 40, num_threads=2)
    alone = WaveformVectorEnv(env, 1)
    alone.reset(seed=0), threaded.reset(seed=0)
    for k in range(1, 11):
        infos = [each.step(np.zeros(each.num_envs, np.int64))[-1] for each in (alone, threaded)]
        for info in infos:
            assert info["lost"].tolist() == is_lost([k] * len(info["lost"]))


def test_a_system_that_reports_its_losses_itself_keeps_its_figure():
    class Own(Story):
        def state_info(self, state):
            return {**super().state_info(state), "lost": np.full(len(state.belief.step), 7)}

    env = WaveformVectorEnv(Own(), 2)
    _, info = env.reset(seed=0)
    assert info["lost"].tolist() == [7, 7]
    assert "astray" not in info
    _, info = WaveformVectorEnv(Burner(), 2).reset(seed=0)
    assert not {"lost", "astray"} & info.keys()
