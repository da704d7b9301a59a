"""What holds of every system in every form: tapes, batches, candidates, parts of a step, truths, Gymnasium's contract.

``check_vector_env`` sees the forms that are not the defaults here, and the defaults in tests/testing/test_check.py.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import oracles
import pytest
from scipy.stats import chi2
from small_systems import BRIEF

from wavegym.core import shortcuts, trees
from wavegym.core.errors import InputError
from wavegym.core.parameters import parameter_infos
from wavegym.envs import WaveformVectorEnv
from wavegym.evaluation.play import make_task
from wavegym.registration import SYSTEMS, full_id
from wavegym.schedulers.registry import make_policy
from wavegym.testing import check_vector_env
from wavegym.testing.check import prediction_defect

Variant = tuple[str, dict[str, Any]]
AHEAD, TOGETHER = (0, 5, 14), 10  # steps that the environments of a batch are ahead, and that it makes
NEAR: dict[str, Any] = {  # targets within the blind ranges of pulses; the second one is hidden, too
    "sensors": ((0.0, -10e3), (9e3, 0.0)), "starts": ((0.0, 0.0, -100.0, 300.0), (8.8e3, 0.05e3, 10.0, -20.0)),
    "births": (0, 2), "lifetime": 30, "horizon": 30, "clutter_density": 1e-6,
    "prior_variance": (4e2, 4e2, 100.0, 100.0), "laws": ("pfm:3", "hfm:0.5"), "durations": (30e-6, 100e-6),
    "sweeps": (4e6,),
}  # fmt: skip
IN_CLUTTER = ("AgileClutter", "BeamAllocation", "EnergyBudget", "EnergyBudgetKnown")
COMING = {"births": (0, 3), "lifetime": 9, "action": "library"}
OWN = {"tracker": "wavegym.trackers.protocol:ExtendedKalman"}
MODELS = "small_systems:two_models"  # a tracker with a memory
FORMS: tuple[Variant, ...] = (
    ("AgileClutter", {"tracker": "jpda", "action": "joint"}),
    ("AgileClutter", {"tracker": "particle", "particles": 20, "action": "box"}),
    ("AgileClutter", NEAR),
    ("RfEo", {"action": "library", "points": (3, 1, 2)}),
    ("RfEo", {"action": "joint", "out_of_view": "inflated"}),
    ("RfEo", {**COMING, "slew_rate": 0.2, "margin": 1.0, "turns": 3, "points": (2, 1, 2)}),
    ("RfEoFar", COMING),
    ("KershawEvans", {"model": "ca", "weights": (1.0, 2.0, 0.5), "prior_variance": (1e4, 1e3, 10.0)}),
    ("KershawEvans", {"action": "box"}),
    ("KershawEvans", {"targets": "scripted", "tracker": "imm", "densities": (1.0, 100.0)}),
    ("Urban", {"transmitters": ((2085.0, 1470.5), (2060.0, 1530.0))}),
    ("CameraSlew", {"platforms": ((0.0, 0.0), (1e3, -2e3))}),
    ("SectorSetup", {"dead_steps": 0, "turn_rate": 0.05}),
    ("RfEo", {**OWN, **COMING, "slew_rate": 0.2, "turns": 3, "points": (2, 1, 2)}),
    ("RfEoFar", {**OWN, "action": "library"}),
    ("CameraSlew", {"tracker": MODELS, "platforms": ((0.0, 0.0), (1e3, -2e3))}),
    ("SectorSetup", {"tracker": MODELS}),
)
EVERY = pytest.mark.parametrize(
    ("name", "settings"),
    [*((id.removeprefix("wavegym/")[:-3], BRIEF.get(id, {})) for id in SYSTEMS), *FORMS],
    ids=str,
)


def made(name: str, settings: dict[str, Any], **more: Any) -> Any:
    return make_task(name, {**settings, **more}).system


def drawn(system: Any, count: int, seed: int = 0) -> np.ndarray:
    """Actions (step, env), each kept for four steps, so that turns and set-ups end."""
    candidates, rng = system.candidates(), np.random.default_rng(seed)
    return np.repeat(candidates[rng.integers(len(candidates), size=(min(system.horizon, 80) // 4 + 1, count))], 4, 0)


def played(system: Any, worlds: Any, actions: np.ndarray, steps: int) -> list[Any]:
    """The states of an episode's first steps."""
    states = [system.initial(worlds)]
    for action in actions[:steps]:
        states.append(system.transition(states[-1], action, worlds))
    return states


def same(one: Any, other: Any) -> None:
    """Equal to the last bit."""
    trees.tree_map(np.testing.assert_array_equal, one, other)


def answers(system: Any, belief: Any, action: np.ndarray, draws: np.ndarray) -> dict[str, Any]:
    """What schedulers and agents ask about a belief."""
    kinds = ((shortcuts.gain, (2, 7)), (shortcuts.delay, ()), (shortcuts.best_action, ()))
    found = {kind.name: search(belief, *more) for kind, more in kinds if (search := kind.of(system))}
    if hasattr(system, "visible_ahead"):
        found["visible_ahead"] = system.visible_ahead(belief, 12)
    return found | {"observe": system.observe(belief), "cost": system.cost(belief)} | {
        "expected": system.predict(belief, action), "given": system.predict(belief, action, draws)
    }  # fmt: skip


@EVERY
def test_a_batch_is_its_elements_even_out_of_step(name, settings):
    system = made(name, settings)
    steps = min(TOGETHER, system.horizon - 1)
    ahead = [min(lag, system.horizon - 1 - steps) for lag in AHEAD]
    worlds, actions = oracles.worlds(system, 3), drawn(system, 3)
    own = [oracles.rows(worlds, slice(e, e + 1)) for e in range(3)]
    alone = [played(system, own[e], actions[:, e : e + 1], ahead[e])[-1] for e in range(3)]
    together = trees.tree_map(lambda *rows: np.concatenate(rows), *alone)
    draws = np.random.default_rng(1).random((steps, 3, *system.outcome_shape))
    for action, draw in zip(actions[:steps], draws, strict=True):
        together = system.transition(together, action, worlds)
        every = answers(system, together.belief, action, draw)
        for e in range(3):
            row = slice(e, e + 1)
            alone[e] = system.transition(alone[e], action[row], own[e])
            same(alone[e], trees.tree_map(lambda a, row=row: a[row], together))
            for question, answer in answers(system, alone[e].belief, action[row], draw[row]).items():
                same(answer, trees.tree_map(lambda a, row=row: a[row], every[question]))


@EVERY
def test_candidates_are_a_loop_over_them_bit_for_bit(name, settings):
    """In the middle of an episode and at its end, with expected and with given outcomes."""
    system, rng = made(name, settings), np.random.default_rng(3)
    worlds, actions, every = oracles.worlds(system, 3), drawn(system, 3), system.candidates()
    few = every[rng.integers(len(every), size=9)] if len(every) > 40 else every
    states = played(system, worlds, actions, min(system.horizon, 30) - 1)
    for belief in (states[min(7, len(states) - 1)].belief, states[-1].belief):
        for given in (None, rng.random((3, len(few), *system.outcome_shape))):
            shared, many = (system.predict(belief, a, given) for a in (few[None], np.repeat(few[None], 3, axis=0)))
            same(shared, many)
            cost = system.cost(many)
            for c, candidate in enumerate(few):
                one = np.stack([candidate] * 3)
                alone = system.predict(belief, one, None if given is None else given[:, c])
                same(alone, trees.tree_map(lambda a, c=c: a[:, c], many))
                same(system.cost(alone), cost[:, c])


@pytest.mark.parametrize("name", [*IN_CLUTTER[1:], "CameraSlew", "SectorSetup", "SectorSetupCity"])
def test_a_gain_takes_a_wait_for_each_candidate(name):
    """The tests of each system check the value of the gain."""
    system = made(name, {})
    for state in played(system, oracles.worlds(system, 5), drawn(system, 5), system.horizon)[3::9]:
        wait = np.random.default_rng(2).integers(0, 4, size=(5, len(system.candidates())))
        each = np.array([shortcuts.gain(system, state.belief, w, 6) for w in range(4)])
        np.testing.assert_array_equal(
            shortcuts.gain(system, state.belief, wait, 6), np.take_along_axis(each, wait[None], axis=0)[0]
        )
        over = state.belief.step[0] + np.arange(4) >= system.horizon
        assert not each[over].any()
    with pytest.raises(InputError, match="ahead is 0, expected an integer >= 1"):
        shortcuts.gain(system, state.belief, 0, 0)


@EVERY
def test_no_action_changes_the_world(name, settings):
    """Targets and tapes are the same under other actions, although the belief is not."""
    system = made(name, settings)
    worlds, kept = oracles.worlds(system, 3), oracles.worlds(system, 3)
    one, other = (played(system, worlds, drawn(system, 3, seed), min(system.horizon, 60)) for seed in (1, 2))
    same(worlds, kept)
    if "targets" in one[-1].truth._fields:
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a.truth.targets, b.truth.targets)
    unequal = []
    trees.tree_map(lambda a, b: unequal.append((a != b).any()), one[-1].belief, other[-1].belief)
    assert any(unequal)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        (
            "AgileClutter",
            [
                {"action": "joint"}, {"action": "box"}, {"laws": ("lfm",)}, {"clutter_density": 0.0}, {"gate": 2.0},
                {"tracker": "particle"}, {"tracker": "jpda"}, {"durations": (1e-4,)}, {"reference_range": 2e4},
            ],
        ),
        ("BeamAllocation", [{"spread": (0.0,) * 4}, {"windows": ((0, 1, 2),)}, {"laws": ("lfm",)}, {"dt": 0.5}]),
        ("SectorSetup", [{"dead_steps": 0}, {"windows": ((0, 1, 2),)}, {"q": (1.0, 1.0)}, {"dt": 0.1}]),
        (
            "RfEo",
            [
                {"action": "joint"}, {"action": "library"}, {"penalty": "hard"}, {"out_of_view": "inflated"},
                {"margin": 1.0}, {"first_estimate": "drawn"}, {"q": 5.0}, {"iterations": 1}, {"as_printed": True},
            ],
        ),
        ("KershawEvans", [{"q": 9.0}, {"action": "box"}, {"sweeps": (0.0,)}, {"reference_range": 2e5}]),
    ],
)  # fmt: skip
def test_what_is_assumed_changes_no_tape(name, changes):
    want = made(name, {}).draw_world(np.random.default_rng(3))
    for change in changes:
        same(made(name, change).draw_world(np.random.default_rng(3)), want)
    for one, other in zip(made(name, {}).draw_world(np.random.default_rng(4)), want, strict=True):
        assert not np.array_equal(one, other)


@EVERY
def test_a_truth_equal_to_the_assumptions_changes_nothing(name, settings):
    own = made(name, settings)
    told = made(name, settings, truth={i.name: getattr(own, i.name) for i in parameter_infos(type(own)) if i.truth})
    assert told.truth_model is not told
    worlds, actions, steps = oracles.worlds(own, 3), drawn(own, 3), min(own.horizon, 40)
    for states in zip(*(played(system, worlds, actions, steps) for system in (own, told)), strict=True):
        same(*states)


CLUTTER = {"q": 40.0, "clutter_density": 2e-5}
CAMERA = {"q": (0.08, 8.0), "turn_rate": 0.05, "detection": 0.3, "fft_length": 32, "bandwidth": 1e6}
RADAR = {"q": 4.0, "turn_rate": 0.05, "fft_length": 32, "pixels": 500, "nearest_range": 20.0, "duty": 0.2, "notch": 5.0}
SECTOR = {
    "q": (1.0, 30.0), "turn_rate": -0.1, "prior_variance": (4e4, 100.0, 4e4, 100.0), "reference_range": 4e3,
    "false_alarm": 1e-4, "nearest_range": 1500.0, "reference_snr": 40.0, "windows": ((0, 2, 5),),
}  # fmt: skip
MODERATE = {"sweeps": (0.0, 0.1e6, -0.1e6), "truth": {"q": 3.0, "reference_range": 280e3}}
PARTS: tuple[Variant, ...] = (
    *((name, {"tracker": by, "components": 4, "truth": CLUTTER}) for name in IN_CLUTTER for by in ("jpda", "mixture")),
    *((name, MODERATE) for name in ("KershawEvans", "KershawEvansPosition")),
    ("KershawEvans", {"model": "ca", "weights": (1, 1, 1), "prior_variance": (1e4, 1e4, 1.0), **MODERATE}),
    *(("CameraSlew", {"platforms": p, "truth": CAMERA}) for p in (((0.0, 0.0),), ((0.0, 0.0), (1e3, -2e3)))),
    *((name, {"out_of_view": m, "truth": RADAR, "folding": False}) for name in ("RfEo", "RfEoFar")
      for m in ("missing", "inflated")),
    ("RfEoFar", {"truth": RADAR}),
    ("RfEo", {"births": (0, 3), "lifetime": 9, "slew_rate": 0.2, "margin": 1.0}),
    ("SectorSetup", {"truth": SECTOR, "turn_rate": 0.05, "receivers": ((-3e3, 0.0), (2e3, 7e3), (5e3, -1e3))}),
    ("SectorSetupCity", {}),
    *FORMS[5:7],
)  # fmt: skip
ROUNDED = (*IN_CLUTTER, "KershawEvans", "KershawEvansPosition")  # sums in an order of their own; R = C (1 / eta)


@pytest.mark.parametrize(("name", "settings"), PARTS, ids=str)
def test_a_compiled_step_is_that_of_its_parts(name, settings):
    """Over whole episodes, on the same worlds: so no gate of a later sensor leaves the windows of ``measure``."""
    system = made(name, settings)
    worlds, tolerance = oracles.worlds(system, 5), 1e-9 if name in ROUNDED else 0.0
    state, clutter = system.initial(worlds), 0.0
    for action in drawn(system, 5)[: min(system.horizon, 80)]:
        composed, state = system.composed_transition(state, action, worlds), system.transition(state, action, worlds)
        trees.tree_map(
            lambda a, b: np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance), composed, state
        )  # fmt: skip
        clutter += state.truth.scan[:, 1].sum() if name in IN_CLUTTER else 1.0
    assert clutter > 0.0


@pytest.mark.parametrize(
    ("name", "settings"),
    [*FORMS, *PARTS, *(("AgileClutter", {**NEAR, "action": a}) for a in ("joint", "box"))],
    ids=str,
)
def test_predictions_and_shortcuts_agree_in_every_form_and_world(name, settings):
    assert prediction_defect(made(name, settings)) is None


WORLDS: tuple[Variant, ...] = (
    *((name, {"truth": CLUTTER, "tracker": "jpda"}) for name in IN_CLUTTER),
    *((name, MODERATE) for name in ("KershawEvans", "KershawEvansPosition")),
    ("KershawEvansPosition", {"truth": {"prior_variance": (9e4, 9e4), "targets": "scripted"}}),
    ("CameraSlew", {"truth": {**CAMERA, "prior_variance": (900.0, 4.0, 900.0, 4.0)}}),
    *((name, {"truth": RADAR}) for name in ("RfEo", "RfEoFar")),
    ("SectorSetup", {"truth": {**SECTOR, "windows": ()}}),
    ("SectorSetupCity", {"truth": {"q": (0.05, 0.5), "turn_rate": 0.02}}),
    *((name, {"truth": {"clutter_density": 4e-3, "sigma": 1.0, "fluctuation": "swerling0"}}) for name in (
        "Urban", "UrbanSignal")),
)  # fmt: skip


@pytest.mark.parametrize(("name", "settings"), WORLDS, ids=str)
@pytest.mark.slow
def test_tracker_and_schedulers_keep_their_assumptions(name, settings):
    """With one belief and the same measurements, all is the same as in the assumed world, except for the targets.

    If the first errors have another spread, the first covariance is still the tracker's.
    """
    other, own = made(name, settings), made(name, {**settings, "truth": None})
    worlds, actions, rng = oracles.worlds(own, 4), drawn(own, 4), np.random.default_rng(1)
    states, assumed = (played(system, worlds, actions, 12) for system in (other, own))
    if "covariance" in own.initial(worlds).belief._fields:
        np.testing.assert_array_equal(states[0].belief.covariance, assumed[0].belief.covariance)
    assert (states[-1].truth.targets != assumed[-1].truth.targets).any()
    for state, action in zip(states, actions[:12], strict=False):
        truth = other.move(state.truth, state.belief.step, worlds)
        found = other.measure(truth, state.belief, action, worlds)
        same(*(system.track(state.belief, action, found) for system in (own, other)))
        draws = rng.random((4, *own.outcome_shape))
        one, two = (answers(system, state.belief, action, draws) for system in (own, other))
        for question, answer in one.items():
            same(answer, two[question])


FOUR = ((-5e3, 0.0, 20e3, 230.0), (0.0, 0.0, 30e3, -210.0), (12e3, -150.0, 45e3, 60.0), (-20e3, 180.0, 55e3, -120.0))
NARROW = {  # one linearisation is enough
    "first_estimate": "drawn", "prior_variance": (25.0, 0.25, 25.0, 0.25), "pixel_angle": (1e-3, 6e-3), "horizon": 60
}  # fmt: skip
CONSISTENT: list[tuple[str, dict[str, Any], str, int]] = [
    *(("KershawEvans", settings, "random", 600) for settings in ({}, FORMS[7][1])),
    *((name, {}, policy, 300) for name in ("KershawEvans", "KershawEvansPosition")
      for policy in ("random", "myopic", "lookahead:2")),
    ("RfEo", {}, "random", 200),
    ("RfEo", {**OWN, **NARROW}, "random", 200),
    ("RfEoFar", {}, "random", 300),
    ("RfEoFar", {"q": 100.0, "starts": FOUR, "horizon": 60}, "random", 150),
    ("RfEoFar", {}, "myopic", 50),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("name", "settings", "policy", "count"), CONSISTENT, ids=str)
def test_the_tracker_is_consistent_in_every_step(name, settings, policy, count):
    """Mean NEES within 5 standard errors in each step, 3 in the last; over all, within 2 of one step's or within 10 %.

    The errors of one step have the chi-square distribution; over the steps they may be wholly correlated: of the short
    episodes of KershawEvans 20 % of the steps may lie outside their 95 % bounds, of others 8 %. The first estimates of
    RfEo are the paper's, no draws from P0: there the first ten steps are left out, and the mean is held to 4.
    """
    system = made(name, settings)
    n, env, chosen = system.nees_dimension, WaveformVectorEnv(system, count), make_policy(policy, system, None)
    env.reset(seed=11)
    chosen.begin(system, count, np.random.default_rng(3))
    nees = [env.step(chosen.act(env.belief, None, None))[-1]["nees"] for _ in range(system.horizon)]
    nees = np.reshape(nees[10:] if name == "RfEo" else nees, (-1, count * nees[0][0].size))
    means, values = nees.mean(axis=1), nees.shape[1]

    def inside(share):
        low, high = chi2.ppf([0.5 * (1.0 - share), 0.5 * (1.0 + share)], n * values) / values
        return (means > low) & (means < high)

    assert inside(1.0 - 6e-7).all(), means
    assert inside(0.998)[-1]
    assert inside(0.95).mean() >= (0.8 if "Kershaw" in name else 0.92)
    error = np.sqrt(2.0 * n / values)
    assert abs(means.mean() - n) < {"RfEo": 4.0 * error, "RfEoFar": 0.1 * n}.get(name, 2.0 * error)


class Times(float):
    """A factor on the parameter of the system."""

    def of(self, value):
        return tuple(self * each for each in value) if isinstance(value, tuple) else self * value


QUIET = {"clutter_density": 0.0}  # no handful of steps sets the mean (docs/consistency_in_clutter.md)
DRAWN = {"first_estimate": "drawn", "prior_variance": (1e4, 4.0, 1e4, 4.0)}
MISTAKEN: list[Any] = [  # what the world differs in, and when it shows
    ("KershawEvans", {}, {"q": 16.0}, 40),
    ("KershawEvans", {}, {"reference_range": 200e3}, 40),
    ("KershawEvans", {"start_covariance": "random"}, {"prior_variance": (9e4, 9e4)}, 1),
    ("CameraSlew", {}, {"q": (0.32, 32.0)}, 20),
    ("CameraSlew", {}, {"turn_rate": 0.05}, 20),
    ("CameraSlew", {}, {"fft_length": 16}, 20),
    ("CameraSlew", {}, {"bandwidth": 2.5e5}, 20),
    ("CameraSlew", {}, {"prior_variance": (900.0, 9.0, 900.0, 9.0)}, 2),
    ("RfEo", DRAWN, {"q": 0.16}, 30),
    ("RfEo", DRAWN, {"turn_rate": 0.5}, 30),
    ("RfEo", DRAWN, {"fft_length": 16}, 30),
    ("RfEo", DRAWN, {"prior_variance": (9e4, 25.0, 9e4, 25.0)}, 1),
    *((name, QUIET, {"turn_rate": 0.05}, 20) for name in IN_CLUTTER),
    *((name, QUIET, {key: Times(factor)}, steps) for name in IN_CLUTTER
      for key, factor, steps in (("q", 4.0, 20), ("prior_variance", 9.0, 2), ("reference_range", 0.45, 20))),
    *(pytest.param(name, {}, truth, steps, marks=mark)
      for name, mark in (("SectorSetup", ()), ("SectorSetupCity", pytest.mark.slow))
      for truth, steps in (
          ({"turn_rate": 0.05}, 20), ({"q": Times(4.0)}, 30), ({"prior_variance": Times(9.0)}, 3))),
]  # fmt: skip


@pytest.mark.parametrize(("name", "settings", "truth", "steps"), MISTAKEN, ids=str)
def test_a_tracker_that_is_not_told_of_the_world_is_overconfident(name, settings, truth, steps):
    """Mean NEES within five standard errors of a consistent tracker's, and beyond."""
    own, nees, costs = made(name, settings), [], []
    truth = {key: value.of(getattr(own, key)) if isinstance(value, Times) else value for key, value in truth.items()}
    count = {"KershawEvans": 500, "CameraSlew": 200, "RfEo": 200}.get(name, 300)
    for more in (truth, {"truth": truth}):
        system = made(name, {**settings, **more})
        state = played(system, oracles.worlds(system, count), drawn(system, count), steps)[-1]
        figures = system.state_info(state)
        nees.append(figures["nees"][figures.get("present", np.full(figures["nees"].shape, True))])
        costs.append(system.cost(state.belief).mean())
    n = system.nees_dimension
    error = 5.0 * np.sqrt(2.0 * n / nees[0].size)
    assert abs(nees[0].mean() - n) < error
    assert nees[1].mean() > (5.0 if name in ("CameraSlew", "SectorSetup", "SectorSetupCity") else n + error)
    assert costs[0] > costs[1] or name != "KershawEvans"


@pytest.mark.parametrize("name", [id.removeprefix("wavegym/")[:-3] for id in SYSTEMS])
@pytest.mark.parametrize(
    ("truth", "words"),
    [
        ({"horizon": 3}, r"truth has 'horizon', expected one of \w+, "),
        ({"prior_varianze": 1.0}, r"truth has 'prior_varianze'"),
    ],
)
def test_a_world_may_differ_in_its_laws_alone(name, truth, words):
    with pytest.raises(InputError, match=words) as caught:
        made(name, {}, truth=truth)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [id.removeprefix("wavegym/")[:-3] for id in SYSTEMS if "Multi" not in id])
def test_the_info_of_a_step_holds_the_measurements(name):
    env = gym.make_vec(full_id(name), num_envs=2, measurements=True, **BRIEF.get(full_id(name), {}))
    env.reset(seed=1)
    found = {key: value for key, value in env.step(env.action_space.sample())[-1].items() if "measured_" in key[:9]}
    assert found
    assert all(len(value) == 2 for value in found.values())
    if "measured_variance" in found:
        assert found["measured_z"].shape == found["measured_variance"].shape
    if name in IN_CLUTTER:
        assert found["measured_z"].shape == (*found["measured_present"].shape, 2)


BRIEFLY = {"horizon": 6}
CONFORMING: tuple[Variant, ...] = (
    ("MultifunctionRadar", {"horizon": 40}),
    ("MultifunctionRadar", {"seconds": 0.3, "targets": 40.0, "slots": 5}),
    *((name, settings) for name, settings in FORMS[:2]),
    *(("RfEo", {"action": form, **BRIEFLY}) for form in ("library", "joint")),
    ("RfEoFar", {"action": "joint", **BRIEFLY}),
    *(("RfEo", {"births": (0, 3), "lifetime": 3, "slew_rate": s, **BRIEFLY}) for s in (0.0, 0.2)),
    ("RfEoFar", {"births": (0, 3), "lifetime": 3, **BRIEFLY}),
    *(("RfEo", {"action": form, "slew_rate": 0.3, "turns": 3, "points": (2, 1, 2), **BRIEFLY}) for form in (
        "library", "joint")),
    ("KershawEvans", {"tracker": "imm", "densities": (1.0, 100.0), **BRIEFLY}),
    *((name, {"tracker": MODELS, **BRIEFLY}) for name in ("CameraSlew", "SectorSetup")),
    ("KershawEvansPosition", {"tracker": "imm", **BRIEFLY}),
    ("Urban", {"horizon": 12, "arrivals": (-10.0, 0.0), **FORMS[10][1]}),
    *(("Urban", {"horizon": 12, "arrivals": (-10.0, 0.0), "error_snr": "realised", **more}) for more in (
        {"fluctuation": "swerling3", "searched": 3}, {"direction_of_arrival": False})),
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("name", "settings"), CONFORMING, ids=str)
def test_it_does_what_gymnasiums_vector_environment_does(name, settings):
    check_vector_env(full_id(name), max_steps=60, **settings)
