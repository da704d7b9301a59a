"""Learned agents and schedulers in one table: the results are what was played, the figures follow from them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from runs_for_tests import ID

from agents import leaderboard as leaderboard
from agents import timing
from wavegym.core.errors import InputError
from wavegym.evaluation import adapters, compare, make_task
from wavegym.evaluation.adapters import as_policies
from wavegym.evaluation.play import EpisodeResults
from wavegym.evaluation.report import compressed
from wavegym.schedulers import Lookahead, Myopic
from wavegym.schedulers.tuned_constants import recorded
from wavegym.systems.kershaw_evans.system import KershawEvans


def entry(**costs: list[float]) -> leaderboard.Entry:
    return leaderboard.Entry(ID, {name.replace("_", "-"): results(cost) for name, cost in costs.items()}, {})


def results(cost: list[float]) -> EpisodeResults:
    """With errors as believed."""
    costs, nothing = np.array([cost]), np.full((1, len(cost)), np.nan)
    return EpisodeResults(
        costs, np.sqrt(costs), np.sqrt(costs), nothing, 2.0 + 0.0 * costs, 0.0 * costs, *[nothing] * 3
    )


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unbroken: dict[str, Path]) -> Path:
    """Small runs in the places of the saved ones, and a ladder of four worlds."""
    for algo in ("ppo", "dqn"):
        shutil.copytree(unbroken[algo], tmp_path / "runs" / "KershawEvansPosition" / algo / "seed1")
    for module in (leaderboard, adapters):
        monkeypatch.setattr(module, "SAVED", tmp_path / "runs")
    for name, folder in {"HEADROOM": "headroom", "LEADERBOARD": "leaderboard"}.items():
        (tmp_path / folder).mkdir()
        monkeypatch.setattr(leaderboard, name, tmp_path / folder)
    monkeypatch.setattr(leaderboard, "WORLDS", 4)
    monkeypatch.setattr(timing, "SINGLES", 3)
    monkeypatch.setattr(leaderboard, "environment_of", lambda folder: {"horizon": 7})
    (tmp_path / "PAGE").write_text(f"before\n{leaderboard.START}\n{leaderboard.END}\nafter\n")
    monkeypatch.setattr(leaderboard, "PAGE", tmp_path / "PAGE")
    policies = {"best-simple": Myopic(), "best-planner": Lookahead(2)}
    ladder = compare(ID, policies, worlds=4, jobs=1, progress=False, horizon=7)
    (tmp_path / "headroom" / "KershawEvansPosition-v0.csv.xz").write_bytes(compressed(ladder.by_policy()))
    return tmp_path


@pytest.mark.slow
def test_accounts_are_what_was_played(folders: Path) -> None:
    leaderboard.play(ID, jobs=1)
    leaderboard.time_decisions(ID)
    found = leaderboard.entry(ID)
    rivals = {"myopic for ppo", "myopic for dqn"}
    assert set(found.by_policy) == {"myopic", "best-simple", "best-planner", "ppo", "dqn", *rivals}
    for name in rivals:  # the same actions here
        np.testing.assert_allclose(found.by_policy[name].cost, found.by_policy["myopic"].cost, rtol=1e-12)
    assert all(results.cost.shape == results.nees.shape == (1, 4) for results in found.by_policy.values())
    again = compare(ID, {"best-simple": Myopic()}, worlds=4, jobs=1, progress=False, horizon=7)
    np.testing.assert_allclose(found.by_policy["best-simple"].cost, again.cost("best-simple"), rtol=1e-12)
    assert set(found.us) == {"best-planner", timing.ALONE, "ppo", "dqn"}
    assert min(found.us.values()) > 0.0
    assert found.against("myopic", "best-simple").value == pytest.approx(0.0)


@pytest.mark.slow
def test_the_tables_go_between_the_marks(folders: Path) -> None:
    leaderboard.play(ID, jobs=1)
    leaderboard.renew([ID])
    page = (folders / "PAGE").read_text()
    assert page.startswith("before")
    assert page.endswith("after\n")
    assert page.count("| KershawEvansPosition-v0") == 6
    confined = [line.split("|")[2:5] for line in page.splitlines() if line.startswith("| KershawEvansPosition ")]
    assert [[cell.strip() for cell in row] for row in confined] == [[a, "horizon=7", "0"] for a in ("PPO", "DQN")]
    assert page.count("By truth:") == 1
    assert "Belief and truth rank" in page or "belief and truth rank" in page
    lines = [line for line in page.splitlines() if line.startswith("| KershawEvansPosition-v0")]
    assert [cell.strip() for cell in lines[2].split("|")[2:4]] == ["rewards", "rewards"]
    assert lines[0].split("|")[2].strip() == recorded(make_task(ID, {}).system)["best-simple"]


@pytest.mark.slow
@pytest.mark.parametrize(("flag", "timed"), [("--times", True), ("--tables", False)])
def test_tables_and_times_can_be_had_without_playing(
    folders: Path, monkeypatch: pytest.MonkeyPatch, flag: str, timed: bool
) -> None:
    leaderboard.play(ID, jobs=1)
    monkeypatch.setattr(leaderboard, "play", None)
    monkeypatch.setattr("sys.argv", ["leaderboard", flag, ID])
    leaderboard.main()
    assert (folders / "leaderboard" / "KershawEvansPosition.json").exists() == timed
    assert "KershawEvansPosition-v0" in (folders / "PAGE").read_text()


def test_a_star_marks_what_holds_in_the_whole_table() -> None:
    simple, noise = np.exp(np.random.default_rng(0).normal(0.0, 1.0, (2, 100)))
    noise = 0.1 * (noise - noise.mean()) / noise.std(ddof=1)  # t of the shifts is 20 and 2.2, p of the second 0.03
    sure, unsure = (list(simple * np.exp(shift + noise)) for shift in (-0.2, -0.022))
    played = entry(best_simple=list(simple), myopic=list(simple), best_planner=sure, ppo=unsure)
    unclear = entry(best_simple=list(simple), myopic=list(simple), best_planner=unsure, ppo=unsure)
    assert leaderboard.established([played], "cost") == {(ID, "best-planner"), (ID, "ppo")}
    assert leaderboard.established([played] + [unclear] * 9, "cost") == {(ID, "best-planner")}
    line = leaderboard.table([played] + [unclear] * 9).splitlines()[2]
    assert line.count("\\*") == 1


def test_what_is_recovered_of_an_established_gain_is_a_share_of_logarithms() -> None:
    played = entry(best_simple=[10.0, 20.0, 5.0], best_planner=[8.0, 16.0, 4.0], ppo=[9.0, 18.0, 4.5])
    share = played.recovered("ppo")
    assert share.value == pytest.approx(np.log(0.9) / np.log(0.8))
    assert share.ci == pytest.approx((share.value, share.value)), "the same in every world"
    assert played.against("ppo", "best-simple").value == pytest.approx(-10.0)
    assert played.error_against("ppo", "best-simple").value == pytest.approx(-10.0)
    nothing = entry(best_simple=[10.0, 20.0, 5.0], best_planner=[8.0, 30.0, 5.0], ppo=[9.0, 18.0, 4.5])
    assert nothing.recovered("ppo") == (None, None)
    rng = np.random.default_rng(0)
    simple = rng.uniform(5.0, 10.0, 400)
    planner, ppo = (simple * np.exp(-gain + 0.05 * rng.standard_normal(400)) for gain in (0.2, 0.1))
    share = entry(best_simple=list(simple), best_planner=list(planner), ppo=list(ppo)).recovered("ppo")
    assert share.value is not None
    assert share.ci is not None
    # By the delta method: independent errors of both means, 0.05 / sqrt(400) each, over a gain of 0.2.
    width = 1.96 * 0.05 / 20.0 / 0.2 * np.sqrt(1.0 + 0.5**2)
    assert share.ci[1] - share.ci[0] == pytest.approx(2.0 * width, rel=0.15)
    assert share.ci[0] < 0.5 < share.ci[1]


@pytest.mark.parametrize(
    ("planner", "by_truth", "words"),
    [
        (0.8, 0.8, "yes, 20.0 %"),
        (0.8, 1.1, "yes, 20.0 % by belief"),
        (0.995, 0.995, "no"),  # established, and less than a per cent
        (1.1, 1.1, "no"),
        (1.0, 1.0, "no: saturated"),
    ],
)
def test_foresight_pays_where_a_gain_is_established(planner: float, by_truth: float, words: str) -> None:
    worlds = np.arange(1.0, 31.0)
    played = entry(best_simple=[*worlds], best_planner=[*(planner * worlds)])
    results = played.by_policy["best-planner"]
    played.by_policy["best-planner"] = results._replace(rmse=np.sqrt(by_truth * worlds)[None])
    assert leaderboard.foresight(played) == words


def test_foresight_is_not_shown_where_the_interval_is_too_wide() -> None:
    worlds = np.arange(1.0, 31.0)
    played = entry(best_simple=[*worlds], best_planner=[*np.where(worlds % 2, 0.5, 2.0) * worlds])
    low, high = played.against("best-planner", "best-simple").ci
    assert low < -1.0 < 0.0 < high
    assert leaderboard.foresight(played).startswith(f"not shown ({low:+.1f} to {high:+.1f}")


def test_medians_are_of_all_worlds_and_seeds() -> None:
    played = entry(best_simple=[10.0, 20.0, 30.0], best_planner=[9.0, 10.0, 27.0], ppo=[8.0, 20.0, 33.0])
    line = leaderboard.medians([played]).splitlines()[-1]
    assert [cell.strip() for cell in line.split("|")[2:-1]] == ["-10.0", "0", ""]


def test_decisions_for_a_single_environment_are_compared() -> None:
    played = entry(best_simple=[10.0, 20.0], best_planner=[8.0, 16.0], ppo=[9.0, 18.0])
    line = leaderboard.details(
        [played._replace(us={timing.ALONE: 3000.0, "best-planner": 200.0, "ppo": 30.0})]
    ).splitlines()[-1]
    assert [cell.strip() for cell in line.split("|")[-5:-1]] == ["3000", "200", "30", "100"]


def test_errors_orders_and_consistency_follow_from_the_accounts(monkeypatch: pytest.MonkeyPatch) -> None:
    worlds = np.arange(1.0, 31.0)
    played = entry(best_simple=[*worlds], myopic=[*worlds], best_planner=[*(0.8 * worlds)], ppo=[*(0.7 * worlds)])
    flattered = played.by_policy["ppo"]._replace(rmse=np.sqrt(1.2 * worlds)[None], nees=4.0 + 0.01 * worlds[None])
    played.by_policy["ppo"] = flattered._replace(lost=np.full((1, 30), 0.5))
    line = leaderboard.errors([played]).splitlines()[-1]
    assert [cell.strip() for cell in line.split("|")[2:-1]] == [
        *("0", "-20.0 \\*", "-20.0 to -20.0", "+20.0 \\*", "+20.0 to +20.0", "", "", "0.000", "0.000", "0.500", "")
    ]
    assert "best-simple against ppo +42.9 % by belief and -16.7 % by truth" in leaderboard.orders([played])
    monkeypatch.setattr(KershawEvans, "nees_dimension", 2, raising=False)
    cells = [cell.strip() for cell in leaderboard.consistency_table([played]).splitlines()[-1].split("|")[2:-1]]
    assert cells[0] == "2"
    assert (cells[1], cells[5]) == ("2.000", "4.155 high")


def test_a_missing_ladder_is_named(folders: Path) -> None:
    (folders / "headroom" / "KershawEvansPosition-v0.csv.xz").unlink()
    with pytest.raises(InputError, match=r"Position-v0\.csv\.xz is missing, expected it from `make headroom`"):
        leaderboard.entry(ID)


def test_an_agent_that_is_not_there_is_named_with_the_way_to_have_it() -> None:
    with pytest.raises(InputError, match=r"none is saved for wavegym/None-v0, .*wavegym train None-v0 --algo ppo"):
        adapters.saved_agent("ppo", "wavegym/None-v0")


def test_saved_agents_are_played_by_name(folders: Path) -> None:
    (policy,) = as_policies("ppo", make_task(ID, {"horizon": 7}), "ppo")
    assert policy.network.kind == "mlp"


def test_policies_are_called_what_the_ladder_played_not_what_is_on_record_now(tmp_path, monkeypatch):
    monkeypatch.setattr(leaderboard, "HEADROOM", tmp_path)
    now = leaderboard.recorded(leaderboard.make_task(ID, {}).system)
    assert leaderboard.names_played(ID) == now
    before = {"tuned_constants": {"best-simple": "cycle", "best-planner": "lookahead:7"}}
    (tmp_path / f"{ID.rpartition('/')[2]}.json").write_text(json.dumps(before))
    assert leaderboard.names_played(ID) == before["tuned_constants"]
