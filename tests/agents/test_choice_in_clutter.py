"""The worth of choosing a train among scatterers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from agents import clutter
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.evaluation import make_task
from wavegym.evaluation.play import play
from wavegym.sensors.scatterers import clutter_power


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


def test_least_clutter_is_the_least_of_all_trains():
    """Of the target in each beam, by the formula; where the beams' targets are hidden any train will do."""
    task = make_task("wavegym/BeamAllocation-v0", {**clutter.systems()["BeamAllocation"], "scatterers": "ground"})
    system, policy = task.system, clutter.LeastClutter()
    policy.begin(system, 3, np.random.default_rng(0))
    belief = system.initial(draw_worlds(system, world_seeds(0, "test", 3))).belief
    action = policy.act(belief, None, None)
    targets = system.predicted_targets(belief).mean
    sets = system.action_set
    for e in range(3):
        for i, place in enumerate(np.array(system.sensors)):
            t = int(np.argmax(sets.illuminated[action[e], i]))
            if belief.visible[e, 0, t]:
                step = targets[e, t, :2] - place
                r = np.hypot(*step)
                each = (system.carrier_hz, r, step @ targets[e, t, 2:] / r)
                powers = [clutter_power(clutter.KINDS["ground"], waveform, *each)[0, 0] for waveform in sets.waveforms]
                assert powers[sets.joint.indices[action[e], i] % 3] <= 1.05 * min(powers) + 0.05


@pytest.mark.slow
def test_the_command_makes_results_page_and_picture(monkeypatch, tmp_path):
    monkeypatch.setattr(clutter, "WORLDS", 4)
    monkeypatch.setattr(clutter, "JOBS", 1)
    monkeypatch.setattr(clutter, "RESULTS", tmp_path / "clutter.json")
    for name in ("PAGE", "PICTURE"):
        monkeypatch.setattr(clutter, name, tmp_path / getattr(clutter, name).name)
    clutter.PAGE.write_text(f"before\n{clutter.START}\n{clutter.END}\nafter\n")
    monkeypatch.setattr("sys.argv", ["clutter"])
    monkeypatch.setattr(clutter, "KINDS", {kind: clutter.KINDS[kind] for kind in ("sea", "rain")})
    clutter.main()
    made = json.loads(clutter.RESULTS.read_text())
    assert list(made[f"{clutter.THRESHOLDS}/sea"]) == ["myopic", "Pf 0.05", "Pf 0.01", "Pf 0.001", "Pf 0.0001"]
    assert clutter.table(made) in clutter.PAGE.read_text()
    assert clutter.PICTURE.read_bytes().startswith(b"\x89PNG")
