"""The study of Kershaw and Evans's loop: what is played, and the closed forms against plain matrices."""

from __future__ import annotations

import json

import numpy as np
import oracles
import pytest
from scipy import optimize

from research.papers.__main__ import main
from research.papers.kershaw_evans import closed_forms, files, numbers, study
from research.papers.kershaw_evans.study import (
    BEST,
    CLOSING,
    DRAWN,
    GATE,
    GRID_GATE,
    GRID_TRACE,
    LONG,
    MOVING,
    POLICIES,
    POSITION,
    RATE,
    RECEDING,
    SCENES,
    SHORT,
    TRACE,
    Case,
)


@pytest.fixture(scope="module")
def played():
    return study.play(4, 3, 1)


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_the_box_has_no_larger_objective_at_the_first_step(played, scene):
    """All policies meet the same first belief; the box holds the library."""
    first = {policy: played.of(scene, policy) for policy in POLICIES}
    for runs in first.values():
        np.testing.assert_allclose(runs.predicted[:, 0], first[TRACE].predicted[:, 0])
    for policy, runs in first.items():
        assert (first[TRACE].cost[:, 0] <= runs.cost[:, 0] * (1 + 1e-9)).all(), policy
        assert (first[GRID_TRACE].cost[:, 0] <= runs.cost[:, 0] * (1 + 1e-9)).all() or policy in (TRACE, GATE)
        assert (first[GATE].gate[:, 0] <= runs.gate[:, 0] * (1 + 1e-9)).all(), policy
        assert (first[GRID_GATE].gate[:, 0] <= runs.gate[:, 0] * (1 + 1e-9)).all() or policy in (TRACE, GATE)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.slow
def test_gate_and_trace_are_those_of_plain_matrices(played, scene):
    loop = study.system(Case(scene, DRAWN, TRACE))
    runs = played.of(scene, TRACE)
    for run, k in ((0, 0), (1, 7), (3, loop.horizon - 1)):
        P, eta = runs.predicted[run, k], runs.eta[run, k]
        R = oracles.chirp_covariance(runs.duration[run, k], runs.sweep[run, k]) / eta
        assert runs.gate[run, k] == pytest.approx(np.sqrt(np.linalg.det(P + R)), rel=1e-9)
        assert eta == pytest.approx((loop.reference_range / runs.range[run, k]) ** 4, rel=0.1)
        R *= eta * (runs.range[run, k] / loop.reference_range) ** 4  # the filter knows the SNR that it receives
        _, updated = oracles.update(np.zeros(2), P, np.zeros(2), np.eye(2), R)
        assert runs.cost[run, k] == pytest.approx(np.diag(updated) @ loop.weights, rel=1e-6)


def test_the_closed_forms_against_an_optimiser_from_many_starts(played):
    for scene, policy, field in ((RATE, GATE, "gate"), (POSITION, TRACE, "trace"), (POSITION, GATE, "gate")):
        loop = study.system(Case(scene, DRAWN, policy))
        runs, (duration, sweep) = played.of(scene, policy), loop.action_set.box.parameters
        P, eta = runs.predicted[1, 5], runs.eta[1, 5]

        def value(x, P=P, eta=eta, loop=loop, field=field):
            R = oracles.chirp_covariance(np.exp(x[0]), 1e6 * x[1]) / eta
            if field == "gate":
                return np.linalg.slogdet(P + R)[1]
            return np.log(np.diag(P - P @ np.linalg.solve(P + R, P)) @ loop.weights)

        bounds = [np.log([duration.low, duration.high]), np.array([sweep.low, sweep.high]) / 1e6]
        starts = np.random.default_rng(0).uniform(*np.transpose(bounds), (12, 2))
        best = min(optimize.minimize(value, start, bounds=bounds).fun for start in starts)
        chosen = value([np.log(runs.duration[1, 5]), runs.sweep[1, 5] / 1e6])
        assert chosen <= best + 1e-7


def test_the_numbers_of_the_closed_forms(played):
    for scene in SCENES:
        found = closed_forms.closed_forms(played, scene)
        for name in ("det_spread", "proportion", "trace_excess", "gate_excess"):
            assert found[name]["mean"] < 1e-6
        assert 0.0 < found["interior"] <= 1.0


def test_a_wrong_choice_shows(played):
    """The planted defect: another pulse than the optimum, and the verdicts are no longer yes."""
    wrong = dict(played.runs)
    case = Case(POSITION, DRAWN, GATE)
    wrong[case] = wrong[case]._replace(duration=1.2 * wrong[case].duration)
    found = closed_forms.closed_forms(study.Study(played.seed, wrong, played.best), POSITION)
    assert found["gate_excess"]["mean"] > 1e-6
    assert found["proportion"]["mean"] > 1e-3


def test_closing_and_receding_targets_start_alike(played):
    for scene, kind in SCENES.items():
        speed = max(abs(end) for end in kind.start_speed)
        closing, receding = (played.of(scene, TRACE, targets).range for targets in (CLOSING, RECEDING))
        assert (np.diff(closing[:, [0, -1]]) < 0).all()
        assert (np.diff(receding[:, [0, -1]]) > 0).all()
        middle = np.mean(kind.start_range)
        assert np.abs(np.stack([closing, receding])[..., 0] - middle).max() < 2 * speed * kind.dt + 100


def test_fixed_pulses_do_not_change(played):
    for scene, kind in SCENES.items():
        for policy in (BEST, LONG, SHORT):
            runs = played.of(scene, policy)
            assert len(np.unique(np.stack([runs.duration, runs.sweep]).reshape(2, -1), axis=1).T) == 1
        assert (played.of(scene, LONG).duration == max(kind.durations)).all()
        assert (played.of(scene, SHORT).duration == min(kind.durations)).all()
        assert (played.of(scene, SHORT).sweep == 0.0).all()


def test_every_case_is_summarised(played, quick):
    summary = numbers.summarise(played)
    json.dumps(summary, allow_nan=False)
    for scene in SCENES:
        assert tuple(summary["scenes"][scene]["policies"]) == POLICIES
        assert tuple(summary["scenes"][scene]["moving"][CLOSING]) == MOVING


@pytest.mark.slow
def test_the_files_are_the_same_for_any_number_of_jobs(tmp_path, capsys, quick):
    for jobs in "12":
        assert main(["kershaw_evans", "--runs", "3", "--jobs", jobs, "--out", str(tmp_path / jobs)]) == 0
    assert {path.name for path in (tmp_path / "1").iterdir()} == set(files.FILES)
    for name in files.FILES:
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()
    assert "| position | trace, closed form |" in capsys.readouterr().out
