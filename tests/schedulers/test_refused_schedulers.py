"""Numbers that no scheduler takes, and systems that a scheduler is not for: refused in one line."""

from __future__ import annotations

import numpy as np
import pytest
from rf_eo_scenes import scene
from scheduler_systems import Ladder, small

from wavegym.core.errors import InputError
from wavegym.schedulers import (
    Continuous,
    Cycle,
    Lookahead,
    Myopic,
    MyopicClosedForm,
    MyopicInformation,
    Optimum,
    Progressive,
)
from wavegym.schedulers.heuristics.cma_search import Budget
from wavegym.schedulers.heuristics.grids import HEURISTICS, SEARCHED_DWELL, TIMELINE
from wavegym.schedulers.heuristics.index_policies import AwareGreedy, CostOfDelay, Gain, Greedy
from wavegym.schedulers.heuristics.price_policies import (
    AdaptiveLagrangianPrice,
    ClearSlotPrice,
    ConstantPace,
    LagrangianPrice,
)
from wavegym.schedulers.heuristics.timeline_rules import GainPerSecond, SearchedDwell
from wavegym.schedulers.heuristics.weighted_myopic import WeightedMyopic
from wavegym.schedulers.planners import BeamSearch, MonteCarloTree, PlanOnce, RolloutPlanner
from wavegym.schedulers.planners.rollout import DwellRollout
from wavegym.schedulers.registry import make_policy
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.systems.camera_slew.system import CameraSlew
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition
from wavegym.systems.multifunction_radar.system import MultifunctionRadar
from wavegym.systems.rf_eo.system import RfEo
from wavegym.systems.urban.system import Urban

BASE = AwareGreedy(0.4, 3)
NUMBERS = [
    (lambda: Myopic("determinent"), "did you mean 'determinant'"),
    (lambda: Myopic(margin=-1), "margin is -1, expected a finite number >= 0"),
    (lambda: MyopicClosedForm("determinant"), "objective is 'determinant', expected one of 'trace', 'gate'"),
    (lambda: Lookahead(0), "lookahead depth is 0, expected at least 1"),
    (lambda: Continuous("traces"), "did you mean 'trace'"),
    (lambda: Continuous(starts=-1), "starts is -1, expected an integer >= 0"),
    (lambda: Progressive(points=2), "points is 2"),
    (lambda: Progressive(levels=0), "levels is 0"),
    (lambda: Cycle([]), "expected one action or more"),
    (lambda: Cycle(3), "expected one action or more"),
    (lambda: Greedy(0), "ahead is 0, expected an integer >= 1"),
    (lambda: AwareGreedy(-1.0), "kappa is -1.0"),
    (lambda: CostOfDelay(later=0), "later is 0"),
    (lambda: CostOfDelay(alpha=np.nan), "alpha is nan"),
    (lambda: Gain(0), "ahead is 0"),
    (lambda: LagrangianPrice(-1.0), "price is -1.0"),
    (lambda: AdaptiveLagrangianPrice(4, 0.0), "thrift is 0.0"),
    (lambda: ConstantPace(4, -1.0), "share is -1.0"),
    (lambda: ClearSlotPrice(ahead=0.0), r"ahead is 0\.0"),
    *((lambda name=name: ClearSlotPrice(**{name: -1.0}), f"{name} is -1.0")
      for name in ("price", "power", "cushion", "reach", "scale")),
    (lambda: Budget(), "budget has no limit, expected evaluations or CPU seconds"),
    (lambda: Budget(most=0), "evaluations is 0"),
    (lambda: Budget(seconds=0.0), "CPU seconds is 0.0"),
    (lambda: Budget(seconds=np.nan), "CPU seconds is nan"),
    (lambda: RolloutPlanner(BASE, 0), "depth is 0"),
    (lambda: RolloutPlanner(BASE, 5, futures=0), "futures is 0"),
    (lambda: RolloutPlanner(BASE, 5, errors=-1.0), "errors is -1"),
    (lambda: BeamSearch(BASE, 0), "beam width is 0"),
    (lambda: MonteCarloTree(BASE, 0), "simulations is 0"),
    (lambda: PlanOnce(BASE, -1), "rounds is -1"),
    (lambda: DwellRollout(GainPerSecond(1.0, 0.5), 1),
     "base of dwell-rollout is 'gain-per-second', expected 'searched-dwell'"),
]  # fmt: skip
ONE, DWELLS = KershawEvansPosition(), MultifunctionRadar()
UNFIT = [
    (Myopic(margin=2.0), KershawEvans(), "'myopic-margin:2' cannot be computed for KershawEvans: it has no margin"),
    (MyopicInformation(), KershawEvans(), "'myopic-information' cannot be computed for KershawEvans"),
    (Continuous("information"), KershawEvans(action="box"), "'myopic-information:polish' cannot be computed"),
    (Continuous(starts=2), scene(action="joint"), "'myopic:slsqp' is not for RfEo in this form, .* action='box'"),
    (Continuous(), scene(penalty="hard"), "'myopic:polish' cannot .* no gradient; nearest: 'myopic'"),
    (Continuous("information", 1), scene(penalty="hard"), "'myopic-information:slsqp' cannot be computed"),
    *((MyopicClosedForm(), system, r"nearest: action='box'") for system in (ONE, Ladder())),
    (MyopicClosedForm(), KershawEvans(action="box"), r"for whole pulses, .* \(nearest: eclipsing=False\)"),
    (Optimum(), Ladder(), "'optimum' cannot be computed for Ladder"),
    (Lookahead(4), KershawEvans(), r"88\^4 sequences"),
    (Lookahead(2), AgileClutter(), r"5184\^2 sequences.*\(nearest: 1\); action='joint'"),
    (Lookahead(4), AgileClutter(action="joint"), r"64\^4 sequences.*\(nearest: 3\)$"),
    (Lookahead(9, most=728), small(horizon=3), r"depth is 9, .* 9\^3 sequences .* \(nearest: 2\)$"),
    (Lookahead(3, most=728), small(horizon=9), r"depth is 3, .* 9\^3 sequences .* \(nearest: 2\)$"),
    (Lookahead(2, most=80), small(horizon=9), r"depth is 2, .* 9\^2 sequences .* \(nearest: 1\)$"),
    (Lookahead(99, most=1e6), small(horizon=99), r"depth is 99, .* 9\^99 sequences .* \(nearest: 6\)$"),
    *((Progressive(), system, "policy 'myopic:progressive' is not for .*expected chirps")
      for system in (ONE, AgileClutter(), AgileClutter(action="joint"))),
    (WeightedMyopic((1.0, 1.0)), CameraSlew(), "its looks have delays"),
    (WeightedMyopic((1.0, 1.0)), Urban(), "weighted-myopic"),
    (WeightedMyopic((1.0, 1.0)), RfEo(weights=np.eye(4).tolist()), "one number for each element"),
    (WeightedMyopic((1.0, 1.0)), RfEo(), "it has 4 weights, not 2"),
    (DwellRollout(SearchedDwell(**SEARCHED_DWELL), 1), ONE, "dwell-rollout"),
    *((HEURISTICS[name].make(**HEURISTICS[name].start), ONE,
       f"'{name}' cannot be computed for KershawEvansPosition: it has no duration") for name in TIMELINE),
    *((make_policy(name, DWELLS, None), DWELLS, "counts steps, expected steps of one length")
      for name in ("lookahead:1", "rollout:5@gain-per-second", "mcts:4@gain-per-second")),
]  # fmt: skip


@pytest.mark.parametrize(("make", "words"), NUMBERS, ids=[words for _, words in NUMBERS])
def test_numbers_that_cannot_be_are_refused(make, words):
    with pytest.raises(InputError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("policy", "system", "words"), UNFIT, ids=[words for *_, words in UNFIT])
def test_systems_that_a_scheduler_is_not_for_are_refused(policy, system, words):
    with pytest.raises(InputError, match=words) as caught:
        policy.begin(system, 1, np.random.default_rng(0))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("policy", "system"),
    [
        (Lookahead(3, most=729), small(horizon=9)),
        (Lookahead(9, most=729), small(horizon=3)),
        (Lookahead(1, most=1), small(horizon=9)),  # as many as the one-step scheduler tries
        (Lookahead(3), KershawEvans()),  # the largest library of the suite
        (Lookahead(1), AgileClutter()),
        (Lookahead(3), AgileClutter(action="joint")),
    ],
)
def test_as_many_sequences_as_can_be_tried_are_not_refused(policy, system):
    """No sequence is longer than the episode."""
    policy.begin(system, 1, None)
