from __future__ import annotations

import warnings

import gymnasium as gym
import numpy as np
import pytest
from evaluation_systems import Uneven

import wavegym
from wavegym.core import shortcuts, worlds
from wavegym.core.errors import InputError, InputWarning
from wavegym.evaluation import Factory, compare, make_task, statistics, summarise, world_seeds
from wavegym.evaluation import comparison as module
from wavegym.evaluation.play import play
from wavegym.schedulers import Fixed, RandomChoice

SMALL = {"horizon": 4}
POSITION = "wavegym/KershawEvansPosition-v0"


def numbers(comparison):
    """Everything except times."""
    return [[array for array in member[:-1]] for members in comparison.played.values() for member in members]


def same(one, other):
    for left, right in zip(one, other, strict=True):
        for a, b in zip(left, right, strict=True):
            np.testing.assert_array_equal(a, b, strict=True)


def test_a_comparison_in_a_notebook_says_what_was_compared():
    shown = repr(compare(POSITION, ["random"], worlds=2, seed=3, jobs=1, progress=False, **SMALL))
    assert shown == "Comparison('wavegym/KershawEvansPosition-v0', ['myopic', 'random'], worlds=2, seed=3)"


@pytest.mark.parametrize("env_id", ["tests/Uneven-v0", POSITION])
def test_the_number_of_jobs_changes_no_number(env_id):
    policies = {"random": None, "lookahead:2": None, "pair": [Fixed(0), RandomChoice()]}
    one, two = (compare(env_id, policies, worlds=120, jobs=jobs, progress=False, **SMALL) for jobs in (1, 2))
    same(numbers(one), numbers(two))
    without_clock = [summarise(c) for c in (one, two)]
    for summary in without_clock:
        for policy in summary["policies"].values():
            assert policy.pop("us_per_decision") > 0
    assert without_clock[0] == without_clock[1]


def test_a_policy_is_played_the_same_in_any_company():
    alone = compare(POSITION, {"random": None}, worlds=3, jobs=1, **SMALL)
    others = compare(POSITION, {"best-fixed": None, "random": None, "myopic": None}, worlds=3, jobs=1, **SMALL)
    same([alone.played["random"][0][:-1]], [others.played["random"][0][:-1]])
    assert list(alone.played) == ["myopic", "random"]  # the baseline is added
    assert list(others.played) == ["best-fixed", "random", "myopic"]


def test_every_world_is_the_one_its_seed_draws_however_the_work_is_cut():
    played = compare("tests/Uneven-v0", {}, worlds=module.CHUNK + 7, seed=3, jobs=1).played["myopic"][0]
    seeds = world_seeds(3, "test", module.CHUNK + 7)
    whole = play(make_task("tests/Uneven-v0", {}), Fixed(0), seeds)  # myopic's choice here is the least gain
    np.testing.assert_array_equal(played.cost, whole.cost)


def test_nothing_is_tuned_on_the_worlds_of_the_test(monkeypatch):
    drawn = []
    draw = worlds.draw_worlds
    monkeypatch.setattr(worlds, "draw_worlds", lambda system, seeds: drawn.extend(seeds) or draw(system, seeds))
    comparison = compare("tests/Uneven-v0", {"best-fixed": None}, worlds=30, jobs=1)
    assert len(drawn) == worlds.tuning_worlds(comparison.task.system)
    assert not set(drawn) & set(comparison.seeds)
    np.testing.assert_array_equal(comparison.cost("best-fixed"), comparison.cost("myopic"))  # both transmit gain 1


def test_long_episodes_are_tuned_on_fewer_worlds():
    counts = [
        worlds.tuning_worlds(make_task(POSITION, {"horizon": steps}).system) for steps in (50, 100, 200, 1000, 9999)
    ]
    assert counts == [200, 200, 100, 20, 20]


def test_parameters_reach_the_system():
    comparison = compare(POSITION, {}, worlds=2, jobs=1, horizon=3, q=50.0)
    assert comparison.task.system.q == 50.0
    assert comparison.played["myopic"][0].cost.shape == (2, 3)


class WithLoop(Uneven):
    """Its baseline from a paper has twice the gains."""


@shortcuts.baselines.register(WithLoop)
def baselines(system: WithLoop):
    return {"louder": ("fixed:0", {"gains": (2.0, 4.0, 8.0)})}


def test_a_named_loop_plays_the_same_worlds_with_parameters_of_its_own():
    """Its first gain is twice the other's, whose scheduler does as well as a fixed choice."""
    wavegym.register("tests/WithLoop-v0", WithLoop)
    try:
        comparison = compare("tests/WithLoop-v0", {"louder": None, "fixed:0": None}, worlds=5, jobs=1, horizon=4)
        np.testing.assert_array_equal(comparison.cost("louder"), 2.0 * comparison.cost("fixed:0"))
        with pytest.raises(InputError, match=r"policy is 'loudr', .* did you mean 'louder'"):
            compare("tests/WithLoop-v0", {"loudr": None}, worlds=2, jobs=1)
    finally:
        del gym.registry["tests/WithLoop-v0"]


class Counting(Fixed):
    """Remembers how many worlds it was begun with."""

    begun: list[int] = []

    def begin(self, system, num_envs, rng):
        self.begun.append(num_envs)
        super().begin(system, num_envs, rng)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"env_id": "KershawEvansPositon-v0"}, "did you mean 'wavegym/KershawEvansPosition-v0'"),
        (
            {"policies": {"first": Counting(0), "myopc": None}},
            "policy is 'myopc'.*did you mean 'myopic'",
        ),
        ({"policies": {"pppo": None}}, "policy is 'pppo', expected .*did you mean 'ppo'"),
        ({"policies": {"DQN": None}}, "policy is 'DQN', expected .*did you mean 'dqn'"),
        ({"policies": {"fixed:400": None}}, r"fixed:400 is no constant action.*nearest: 55"),
        ({"worlds": 0}, "worlds is 0, expected an integer >= 1"),
        ({"jobs": 0}, "jobs is 0, expected an integer >= 1"),
        ({"until": 0.0}, "until is 0.0, expected a finite number > 0"),
        ({"until": "1"}, "until is '1', expected a finite number > 0"),
        ({"by": "truth"}, "by is 'truth', expected until"),
        ({"candidates": True}, "candidates is True, expected an integer >= 1"),
        ({"candidates": 2, "observation": "measurements"}, "observation is 'measurements', expected 'belief'"),
        ({"by": "belif"}, "by is 'belif', expected .*did you mean 'belief'"),
        ({"seed": -1}, "seed is -1"),
        ({"horizn": 5}, "unexpected keyword argument 'horizn'.*did you mean 'horizon'"),
        ({"reward": "log-cost"}, "reward is no parameter of .*, expected it in gym.make only"),
    ],
)
def test_mistakes_are_named_before_the_work_begins(monkeypatch, change, words):
    monkeypatch.setattr(module, "run_all", None)  # the work
    arguments = {"env_id": POSITION, "policies": {}, "worlds": 2, "jobs": 1, **change}
    with pytest.raises(InputError, match=words):
        compare(**arguments)


@pytest.mark.parametrize("by", ["belief", "truth"])
def test_worlds_are_played_until_the_intervals_are_narrow(by):
    """Further worlds are those of one longer comparison, in the same batches."""
    common = {"jobs": 1, "progress": False, **SMALL}
    first = compare(POSITION, ["random"], worlds=module.CHUNK, **common)
    low, high = first.against("random", by=by).ci
    narrow = compare(POSITION, ["random"], worlds=20, until=0.5 * (high - low) / 2.0, by=by, **common)
    count = len(narrow.seeds)
    assert 3 * module.CHUNK <= count <= 8 * module.CHUNK  # the width falls with the root of the worlds
    assert np.ptp(narrow.against("random", by=by).ci) <= 0.5 * (high - low)
    same(numbers(narrow), numbers(compare(POSITION, ["random"], worlds=count, **common)))


def test_a_width_that_takes_too_many_worlds_is_told(monkeypatch):
    monkeypatch.setattr(module, "MOST_WORLDS", 100)
    with pytest.warns(InputWarning, match=r"of 'random' is .* % wide on one side after 100 worlds, expected 0.001 %"):
        found = compare(POSITION, ["random"], worlds=50, until=0.001, jobs=1, progress=False, **SMALL)
    assert len(found.seeds) == 100


@pytest.mark.slow
def test_stopping_at_a_width_keeps_the_coverage():
    """Log-normal ratios of a known geometric mean: 150 comparisons, each of the worlds that the width takes."""
    ratio, covered, repeats = 0.9, 0, 150
    rng = np.random.default_rng(4)

    class Drawn:
        """What the rule reads of a comparison."""

        played = ("mine",)

        def __init__(self):
            self.costs = rng.lognormal(np.log(ratio), 0.5, (1, 5000))
            self.count = 50

        def against(self, name, by):
            values = self.costs[:, : self.count]
            return statistics.difference(values, np.ones_like(values), np.random.default_rng(0)).geometric

    for _ in range(repeats):
        drawn = Drawn()
        while (
            worlds := module._enough_worlds(drawn.count, module._widths(drawn, "belief")["mine"], 6.0)
        ) > drawn.count:
            drawn.count = worlds
        low, high = drawn.against("mine", "belief").ci
        covered += low <= 100.0 * (ratio - 1.0) <= high
    assert covered / repeats > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / repeats)


def test_a_learned_policy_that_costs_more_than_myopic_is_told_so():
    worse = {"mine": lambda observation: np.zeros(len(observation), np.int64)}
    with pytest.warns(
        InputWarning, match=r"policy 'mine' costs .* % \[.*\] more than 'myopic', which needs no training"
    ):
        compare(POSITION, worse, worlds=30, jobs=1, progress=False, **SMALL)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compare(POSITION, {"random": None, "floor": "fixed:0"}, worlds=30, jobs=1, progress=False, **SMALL)


@pytest.mark.parametrize("price", [float("nan"), float("inf"), -float("inf")])
def test_costs_that_are_not_finite_are_refused(price):
    words = "policy 'myopic' has a cost that is not finite in 3 of 3 worlds.*parameters .* out of range"
    with pytest.raises(InputError, match=words) as caught:
        compare("tests/Hopeless-v0", {}, worlds=3, jobs=1, price=price)
    assert "\n" not in str(caught.value)


def test_kernels_are_compiled_before_other_processes_start(monkeypatch):
    class Stop(Exception):  # noqa: N818
        pass

    def work(*arguments):
        raise Stop

    Counting.begun.clear()
    monkeypatch.setattr(module, "run_all", work)
    with pytest.raises(Stop):
        compare(POSITION, {"own": Counting(0)}, worlds=2, jobs=2, **SMALL)
    assert Counting.begun == [1]  # the baseline's name comes first, then this one's single step on one world


def test_an_interrupted_comparison_goes_on_where_it_stopped(tmp_path, monkeypatch):
    """The same numbers to the last bit, except for times; no files are left, and other worlds give other numbers."""
    common = {"env_id": POSITION, "policies": ["random"], "jobs": 1, "progress": False, "horizon": 5}
    whole = compare(worlds=110, **common)
    batches = []

    def counted(task, policy, seeds, max_steps=None, name="", watch=None):
        if max_steps is None:  # not to load kernels
            batches.append((name, len(seeds)))
            if len(batches) == 5:
                raise KeyboardInterrupt
        return play(task, policy, seeds, max_steps, name, watch)

    monkeypatch.setattr(module, "play", counted)
    with pytest.raises(KeyboardInterrupt):
        compare(worlds=110, keep=tmp_path, **common)
    assert batches == [("myopic", 50), ("myopic", 50), ("myopic", 10), ("random", 50), ("random", 50)]
    batches.clear()
    again = compare(worlds=110, keep=tmp_path, **common)
    assert batches == [("random", 50), ("random", 10)]
    assert list(tmp_path.iterdir()) == []
    same(numbers(whole), numbers(again))


def test_a_system_without_candidates_is_told_apart_from_a_bug():
    def needs_more(system):
        raise NotImplementedError

    with pytest.raises(InputError, match="policy 'greedy' cannot play tests/Uneven-v0"):
        compare("tests/Uneven-v0", {"greedy": Factory(needs_more)}, worlds=2, jobs=1)


def test_a_foreign_package_is_imported_for_its_id():
    with pytest.raises(InputError, match="package is 'no_such_package', expected an importable one"):
        make_task("no_such_package:Some/Env-v0", {})
    assert make_task("wavegym.envs:wavegym/KershawEvans-v0", {}).env_id == "wavegym/KershawEvans-v0"


def test_names_alone_are_short_for_schedulers():
    comparison = compare("tests/Uneven-v0", ["random"], worlds=2, jobs=1, progress=False)
    assert list(comparison.played) == ["myopic", "random"]
    with pytest.raises(InputError, match=r"policies is 'random', expected names such as \['myopic'\] or a dictionary"):
        compare("tests/Uneven-v0", "random", worlds=2, jobs=1, progress=False)
