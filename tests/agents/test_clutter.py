"""The worth of choosing a train among scatterers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from agents import clutter
from wavegym.core.worlds import world_seeds
from wavegym.evaluation import make_task
from wavegym.evaluation.play import play


@pytest.mark.parametrize("name", ["BeamAllocation", "AgileClutter"])
def test_one_train_and_trains_in_turn_send_nothing_else(name):
    """By the number of the train that each radar sends; beams are chosen as the one-step scheduler does."""
    task = make_task(f"wavegym/{name}-v0", {**clutter.systems()[name], "scatterers": "ground"})
    system, sent = task.system, []

    def watch(policy):
        class Watched(type(policy)):
            def act(self, belief, observation, mask):
                action = super().act(belief, observation, mask)
                rows, windows = system.action_set.windows(action)
                sent.append(windows[rows, -1])
                return action

        return Watched(policy.number)

    for number, want in ((1, lambda k: 1), (None, lambda k: k % 3)):
        sent.clear()
        play(task, watch(clutter.OneTrain(number)), world_seeds(0, "test", 3))
        for k, trains in enumerate(sent):
            assert (trains == want(k)).all()


def test_the_page_shows_the_committed_results():
    results = json.loads(clutter.RESULTS.read_text())
    page = clutter.PAGE.read_text()
    assert clutter.table(results) in page
    assert {place.split("/")[1] for place in results} == {"none", *clutter.KINDS}
    for policies in results.values():
        assert policies["myopic"]["belief"]["value"] == policies["myopic"]["truth"]["value"] == 0.0
        assert all(np.isfinite(each["nees"]) for each in policies.values())


@pytest.mark.slow
def test_the_command_makes_results_page_and_picture(monkeypatch, tmp_path):
    monkeypatch.setattr(clutter, "WORLDS", 4)
    monkeypatch.setattr(clutter, "RESULTS", tmp_path / "clutter.json")
    for name in ("PAGE", "PICTURE"):
        monkeypatch.setattr(clutter, name, tmp_path / getattr(clutter, name).name)
    clutter.PAGE.write_text(f"before\n{clutter.START}\n{clutter.END}\nafter\n")
    monkeypatch.setattr("sys.argv", ["clutter"])
    beams = {"BeamAllocation": clutter.systems()["BeamAllocation"]}
    monkeypatch.setattr(clutter, "systems", lambda: beams)
    clutter.main()
    assert clutter.table(json.loads(clutter.RESULTS.read_text())) in clutter.PAGE.read_text()
    assert clutter.PICTURE.read_bytes().startswith(b"\x89PNG")
