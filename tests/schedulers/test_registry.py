from __future__ import annotations

import re

import numpy as np
import oracles
import pytest
from rf_eo_scenes import scene

import wavegym
from wavegym.core import registry, shortcuts
from wavegym.core.errors import InputError
from wavegym.core.system import State, System
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.envs import WaveformVectorEnv
from wavegym.envs.rewards import make_reward
from wavegym.schedulers import Continuous, Cycle, Fixed, Lookahead, Myopic, RandomChoice, RoundRobin, rollout
from wavegym.schedulers import registry as schedulers
from wavegym.schedulers.heuristics.grids import HEURISTICS, TIMELINE
from wavegym.schedulers.myopic import OBJECTIVES
from wavegym.schedulers.registry import MEANINGS, RENAMED, SCHEDULERS, is_scheduler, make_policy
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition, World
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

SYSTEM = KershawEvans(horizon=3)
WORLDS = World(*(np.stack([a, a]) for a in SYSTEM.draw_world(np.random.default_rng(0))))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("random", RandomChoice),
        ("round-robin", RoundRobin),
        ("fixed:7", Fixed),
        ("best-fixed", Fixed),
        ("tuned-constant", Cycle),
        ("tuned-cycle", Cycle),
        ("myopic", Myopic),
        ("myopic:exhaustive", Myopic),
        ("myopic:determinant", Myopic),
        ("myopic:gate", Myopic),
        ("myopic:mean-trace", Myopic),
        ("lookahead:3", Lookahead),
    ],
)
def test_every_name_makes_its_policy(name, kind):
    policy = make_policy(name, SYSTEM, WORLDS)
    assert type(policy) is kind
    assert is_scheduler(name)


def test_a_scheduler_of_the_suite_is_made_without_reading_all_installed_packages(monkeypatch):
    monkeypatch.setattr(registry, "entry_points", lambda group: pytest.fail("read"))
    assert isinstance(make_policy("myopic", SYSTEM, WORLDS), Myopic)


def test_numbers_and_objectives_arrive():
    assert make_policy("fixed:7", SYSTEM, WORLDS).constant == 7
    assert make_policy("lookahead:3", SYSTEM, WORLDS).depth == 3
    for name, objective in [
        ("myopic", "trace"),
        ("myopic:determinant", "determinant"),
        ("myopic:gate", "gate"),
        ("myopic:mean-trace", "mean-trace"),
    ]:
        assert make_policy(name, SYSTEM, WORLDS).objective is OBJECTIVES[objective]
    assert make_policy("myopic", SYSTEM, WORLDS).fused
    assert not make_policy("myopic:exhaustive", SYSTEM, WORLDS).fused


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("myopc", "did you mean 'myopic'"),
        ("Random", "did you mean 'random'"),
        ("bestfixed", "did you mean 'best-fixed'"),
        ("lookahed:2", "did you mean 'lookahead:H'"),
        ("myopic:gates", "did you mean 'myopic:gate'"),
        ("", "policy is '', expected one of"),
        ("fixed", "nearest: 'fixed:2'"),
        ("fixed:K", "expected fixed: and an integer"),
        ("fixed:4.2", "nearest: 'fixed:4'"),
        ("lookahead:two", "expected lookahead: and an integer"),
        ("lookahead:0", "lookahead depth is 0, expected at least 1"),
        ("myopic:slsq", "did you mean 'myopic:slsqp'"),
        ("myopic-informaton", "did you mean 'myopic-information'"),
        ("myopic-margin", "expected myopic-margin: and a number >= 0 \\(nearest: 'myopic-margin:2'\\)"),
        ("myopic-margin:two", "nearest: 'myopic-margin:2'"),
        ("myopic-margin:nan", "nearest: 'myopic-margin:2'"),
        ("myopic-margin:-1.5", "nearest: 'myopic-margin:0'"),
        ("myopic-margin:2", "cannot be computed for KershawEvans: it has no margin; nearest: 'myopic'"),
        ("myopic-information", "cannot be computed for KershawEvans: it has no most_information; nearest: 'myopic'"),
        ("myopic:polish", "'myopic:polish' is not for KershawEvans in this form, expected action='box'"),
    ],
)
def test_unknown_names_and_numbers_are_answered_with_the_nearest(name, words):
    with pytest.raises(InputError, match=words):
        make_policy(name, SYSTEM, WORLDS)


@pytest.mark.parametrize("index", [-1, 88])
def test_a_candidate_that_does_not_exist_is_refused(index):
    with pytest.raises(InputError, match="expected 0 to 87"):
        make_policy(f"fixed:{index}", SYSTEM, WORLDS)


class Named(KershawEvans):
    """One constant has a name."""


@shortcuts.named_constants.register(Named)
def named_constants(system: Named):
    return {"published": np.array(9)}


def test_a_constant_goes_by_its_name_or_its_number():
    system = Named(horizon=3)
    for name, action in (("fixed:published", 9), ("fixed:4", 4)):
        policy = make_policy(name, system, WORLDS)
        policy.begin(system, 2, np.random.default_rng(0))
        assert policy.act(system.initial(WORLDS).belief, None, None).tolist() == [action] * 2
        assert is_scheduler(name)


@pytest.mark.parametrize("name", ["fixed:publish", "fixed:", "fixed:4.2", "fixed:88"])
def test_a_name_that_the_system_lacks_is_refused_in_one_line(name):
    with pytest.raises(InputError, match=f"^{name} is no constant action, expected 0 to 87, 'published'") as caught:
        make_policy(name, Named(horizon=3), WORLDS)
    assert "\n" not in str(caught.value)
    assert ("did you mean 'published'" in str(caught.value)) == (name == "fixed:publish")


class Belief(System):
    """Neither covariance nor gate."""

    def initial(self, world):
        return State(None, None)


@pytest.mark.parametrize("name", ["myopic:determinant", "myopic:gate"])
def test_objectives_that_a_system_cannot_have_are_refused(name):
    with pytest.raises(InputError, match=f"'{name}' cannot be computed for Belief"):
        make_policy(name, Belief(), WORLDS)


INFORMATION = ["myopic-information", "myopic-information:slsqp", "myopic-information:polish"]
OTHERS = [*INFORMATION, "myopic-margin:M", "myopic:progressive"]  # need another system
DELAYED = [
    "greedy",
    "aware-greedy",
    "cost-of-delay",
    "hold-until-detected",
    "lagrangian-price",
    "adaptive-lagrangian-price",
    "constant-pace",
    "clear-slot-price",
]  # need a gain
BAND = [name for name, meaning in MEANINGS.items() if meaning.startswith("in a shared band")]
LONG = ["best-simple", "best-planner", "receding-horizon", "plan-once", "cycle"]  # tuned on the spot
NUMBERED = [name for name in MEANINGS if re.fullmatch("[a-z-]+:[A-Z]+", name)]
PLAIN = [name for name in MEANINGS if name not in (*NUMBERED, *OTHERS, *DELAYED, *BAND, *LONG)]
BOX = ("myopic:closed-form", "myopic:slsqp", "myopic:polish")


@pytest.mark.parametrize("name", [*INFORMATION, "myopic:slsqp", "myopic:polish", "myopic-margin:1.5", "lookahead:9"])
def test_the_schedulers_of_rf_eo_platforms(name):
    system = scene(horizon=2)
    policy = make_policy(name, system, None)
    assert is_scheduler(name)
    played = rollout(system, policy, oracles.worlds(system, 2))
    assert np.isfinite(played.cost).all()
    if isinstance(policy, Continuous):
        assert policy.objective == ("information" if "information" in name else "trace")
        assert policy.starts == (8 if name.endswith("slsqp") else 0)
    if isinstance(policy, Myopic):
        assert policy.margin == 1.5


@pytest.mark.parametrize("name", [*PLAIN, "fixed:3", "lookahead:1", "lookahead:3", "gain:2"])
def test_every_scheduler_gets_through_gymnasiums_loop(name):
    """In the default autoreset mode a policy is also asked at the step that only resets, when its episode is over."""
    action, eclipsing = "box" if name in BOX else "library", name != "myopic:closed-form"
    if name in TIMELINE:
        envs = WaveformVectorEnv(MultifunctionRadar, 2, horizon=4, slots=8, settled=0.0)
    else:
        envs = WaveformVectorEnv(KershawEvansPosition, 2, horizon=4, action=action, eclipsing=eclipsing)
    policy = make_policy(name, envs.system, draw_worlds(envs.system, world_seeds(0, "tune", 3)))
    observation, _ = envs.reset(seed=0)
    policy.begin(envs.system, 2, np.random.default_rng(0))
    if hasattr(policy, "reveal"):
        policy.reveal(envs.world)
    ends = 0
    for _ in range(12):
        observation, _, terminated, truncated, _ = envs.step(policy.act(envs.belief, observation, None))
        ends += int((terminated | truncated).sum())
    assert ends == 4


def test_folders_are_no_schedulers():
    assert not any(is_scheduler(name) for name in ("ppo", "runs/ppo", "myopic2", ""))
    assert {"lookahead:H", "fixed:NAME", "rollout:H"} <= set(NUMBERED)


def test_every_name_has_a_meaning_and_nothing_else_has():
    families = {"fixed", "myopic-margin", *schedulers.NUMBERED, *schedulers.PLANNERS}
    numbered = {name.partition(":")[0] for name in NUMBERED}
    assert numbered == families
    assert {*MEANINGS} - {*NUMBERED} == {*schedulers.PLAIN, *schedulers.PLANS}
    assert len(set(MEANINGS.values())) == len(MEANINGS)


def test_a_name_that_only_the_box_has_is_told_so():
    with pytest.raises(InputError, match=r"'fixed:proposed', which is a point of the box, expected .*action='box'"):
        make_policy("fixed:proposed", scene(action="library"), None)


@pytest.mark.parametrize(("old", "new"), RENAMED.items())
def test_a_name_of_yesterday_is_answered_with_todays(old, new):
    for name in (old, f"{old}@myopic", f"rollout:2@{old}"):
        if name == f"{old}@myopic" and old != "replan":
            continue
        with pytest.raises(InputError, match=f"^policy is '{old}', which is called '{new}' now$"):
            make_policy(name, SYSTEM, WORLDS)
    assert is_scheduler(old)
    assert is_scheduler(new)
    if new in HEURISTICS:
        with pytest.raises(InputError, match=f"^reference policy is '{old}', which is called '{new}' now$"):
            make_reward(f"relative:{old}")


def test_a_scheduler_of_another_package_is_made_by_its_name(monkeypatch):
    monkeypatch.setattr(SCHEDULERS, "added", {})
    wavegym.register_scheduler("third", lambda system, worlds: Fixed(3))
    wavegym.register_scheduler("worlds", lambda system, worlds: worlds)
    assert is_scheduler("third")
    assert make_policy("third", SYSTEM, WORLDS).constant == 3
    assert make_policy("rollout:2@third", SYSTEM, WORLDS).futures.base.policy.constant == 3
    with pytest.raises(InputError, match=r"policy is 'thirt', expected one of .*did you mean 'third'"):
        make_policy("thirt", SYSTEM, WORLDS)
    with pytest.raises(InputError, match=r"scheduler 'worlds' made .*, expected a Policy with begin and act"):
        make_policy("worlds", SYSTEM, None)
    with pytest.raises(InputError, match="scheduler 'myopic' is registered already"):
        wavegym.register_scheduler("myopic", lambda system, worlds: Fixed(3))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("rollout:2@", "policy is '', expected one of"),
        ("rollout:2@myopc", "policy is 'myopc', .*did you mean 'myopic'"),
        ("rollout@myopic", "policy is 'rollout', expected rollout: and an integer"),
        ("myopic@random", "policy is 'myopic@random', expected one of"),
    ],
)
def test_a_planner_on_a_base_that_is_none_is_refused(name, words):
    with pytest.raises(InputError, match=words):
        make_policy(name, SYSTEM, WORLDS)
