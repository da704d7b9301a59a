from __future__ import annotations

import json
import lzma
import re
import shutil

import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.evaluation import compare, headroom
from wavegym.schedulers import tuned_constants
from wavegym.schedulers.heuristics.index_policies import AwareGreedy
from wavegym.schedulers.planners import MonteCarloTree, RecedingHorizon, RolloutPlanner

pytestmark = pytest.mark.usefixtures("delay_environment")
DELAY = "tests/Delay-v0"


@pytest.mark.slow
def test_planners_play_the_same_whatever_the_number_of_jobs():
    policies = {
        "rollout": RolloutPlanner(AwareGreedy(), 4, futures=8),
        "receding-horizon": RecedingHorizon(AwareGreedy(), 4, rounds=1, first=2, futures=8),
        "mcts": MonteCarloTree(AwareGreedy(), 4, 3, futures=8),
    }
    one, two = (compare(DELAY, policies, worlds=60, jobs=jobs, progress=False) for jobs in (1, 2))
    for name in policies:
        np.testing.assert_array_equal(one.cost(name), two.cost(name))


def test_a_searched_rule_on_record_for_other_features_is_not_left_out_in_silence(monkeypatch):
    monkeypatch.setattr(headroom, "LADDER", ("random", "searched-rule"))
    stale = {"searched-rule": {"features": ["gone"], "weights": [1.0], "scales": [1.0]}}
    monkeypatch.setattr(tuned_constants, "recorded", lambda system: stale)
    with pytest.raises(InputError, match="gone"):
        headroom.ladder(DELAY, 2, 0, 1, progress=False)


def test_the_ladder_holds_what_the_system_admits(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(headroom, "LADDER", ("random", "gain:2", "rollout:2", "myopic-information"))
    monkeypatch.setattr(headroom, "SIMPLE", "gain:2")
    monkeypatch.setattr(headroom, "_made", lambda name, system, tuning: headroom_made(name, system))
    comparison = headroom.ladder(DELAY, 4, 0, 1, progress=False)
    assert set(comparison.played) == {"random", "gain:2", "rollout:2", "myopic"}


@pytest.mark.slow
def test_policies_played_again_join_those_on_file(monkeypatch, tmp_path):
    """The files are those of a ladder played at once, except for times and the order of the rows."""
    monkeypatch.setattr(headroom, "LADDER", ("random", "myopic", "gain", "best-simple", "best-planner"))

    def ladder(*options, to):
        headroom.main(
            ["KershawEvansPosition-v0", "--worlds", "4", "--jobs", "1", *options, "--out", str(tmp_path / to)]
        )
        found = json.loads((tmp_path / to / "KershawEvansPosition-v0.json").read_text())
        for row in found["policies"].values():
            del row["us_per_decision"]
        return found, sorted(rows(tmp_path / to / "KershawEvansPosition-v0.csv.xz").splitlines())

    whole = ladder(to="whole")
    shutil.copytree(tmp_path / "whole", tmp_path / "again")
    table = tmp_path / "again" / "KershawEvansPosition-v0.csv.xz"
    table.write_bytes(lzma.compress(rows(table).replace("gain,0,", "gain,0,9").encode()))  # wrong: to be played anew
    assert ladder("--policies", "gain", to="again") == whole
    with pytest.raises(InputError, match=re.escape("has (seed, worlds) = (0, 4), expected (0, 5)")):
        headroom.main(
            ["KershawEvansPosition-v0", "--worlds", "5", "--policies", "gain", "--out", str(tmp_path / "again")]
        )


def rows(file):
    """The text of a compressed table."""
    return lzma.decompress(file.read_bytes()).decode()


def headroom_made(name, system):
    """Without tuning, which is tested elsewhere."""
    if name == "rollout:2":
        return RolloutPlanner(AwareGreedy(), 2, futures=4)
    if name == "myopic-information":
        raise InputError("no information here")
    return None


def test_mistakes_are_told_before_anything_is_played(capsys):
    status = headroom.guarded(lambda: headroom.main(["CameraSlow-v0", "--out", "x"]))
    assert status == 2
    assert "CameraSlew-v0" in capsys.readouterr().err
