"""Policies under distribution shift."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents import distribution_shift as shift
from agents.experiment import load_experiments
from wavegym.core.errors import InputError
from wavegym.evaluation import compare, make_task
from wavegym.registration import SYSTEMS, full_id
from wavegym.systems.kershaw_evans.system import KershawEvansPosition

CASES = [(env, name, given) for env, shifts in shift.load_shifts().items() for name, given in shifts.items()]


@pytest.mark.parametrize(("env", "name", "given"), CASES, ids=[f"{env}: {name}" for env, name, _ in CASES])
@pytest.mark.slow
def test_every_shift_is_another_world_that_shows_the_same_elements(env: str, name: str, given: dict) -> None:
    env_id = full_id(env)
    assert env_id in SYSTEMS
    here, there = make_task(env_id, {}).system, make_task(env_id, given).system
    assert here != there
    assert here.observation_fields == there.observation_fields  # or no agent could be played there


FACTORS = {
    ("SNR -3 dB", "reference_snr"): 10**-0.3,
    ("SNR -3 dB", "reference_range"): 10 ** (-3 / 40),  # eta falls with its fourth power
    ("process noise x4", "q"): 4.0,
    ("clutter x4", "clutter_density"): 4.0,
}


@pytest.mark.parametrize(("env", "name", "given"), CASES, ids=[f"{env}: {name}" for env, name, _ in CASES])
def test_a_shift_changes_as_much_as_its_name_says(env: str, name: str, given: dict) -> None:
    made_for = make_task(env, {}).system
    known = [(key, FACTORS[name, key]) for key in given if (name, key) in FACTORS]
    if hasattr(made_for, "waveforms"):  # errors at the reference SNR, which scales with it: that moves Pd alone
        assert "reference_snr" not in given
    assert known or name not in {shift for shift, _ in FACTORS}
    for key, factor in known:
        np.testing.assert_allclose(given[key], factor * np.array(getattr(made_for, key)), rtol=5e-3)  # half is -3.01 dB


@pytest.mark.slow
def test_rules_keep_the_constants_they_were_tuned_with(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(shift, "WORLDS", 4)
    monkeypatch.setattr(shift, "PLANNED", 3)
    monkeypatch.setattr(shift, "SAVED", tmp_path)
    found = shift.play("SectorSetup", {"harder": {"reference_snr": 10.0}, "none": {}}, jobs=1)
    none, harder = (found[name][shift.KNOWN]["policies"] for name in ("none", "harder"))
    assert none["best-simple"]["belief"]["percent"] == harder["best-simple"]["belief"]["percent"] == 0.0
    assert set(harder) == {"myopic", "best-simple"}
    assert harder["myopic"]["belief"]["percent"] > 0.0
    assert harder["myopic"]["truth"]["percent"] > 0.0
    assert np.isfinite(harder["myopic"]["nees"]["mean"])
    planner = found["none"][shift.UNKNOWN]["policies"]["best-planner"]
    alone = compare("SectorSetup-v0", ["best-simple", "best-planner"], worlds=3, jobs=1)  # the first of the same worlds
    ratio = alone.cost("best-planner") / alone.cost("best-simple")
    assert planner["belief"]["percent"] == pytest.approx(100.0 * (np.exp(np.log(ratio).mean()) - 1.0), rel=1e-6)
    assert found["none"][shift.KNOWN]["policies"].keys() == {"myopic", "best-simple"}
    kept = {name: {**halves, shift.UNKNOWN: {"policies": {"best-planner": "kept"}}} for name, halves in found.items()}
    again = shift.play("SectorSetup", {"none": {}}, jobs=1, before=kept)["none"][shift.UNKNOWN]["policies"]
    assert again == {**found["none"][shift.UNKNOWN]["policies"], "best-planner": "kept"}
    known, unknown = shift.tables({"SectorSetup": found}).split("The tracker does not know it.")
    assert known.startswith("The tracker knows the change. By belief:")
    assert "best planner" in unknown
    assert "best planner" not in known
    assert known.count("| SectorSetup | harder") == 2  # by belief and by truth
    assert unknown.count(" none |") == 2


@pytest.mark.slow
def test_observations_outside_the_training_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shift, "WORLDS", 6)
    monkeypatch.setattr(shift, "COUNTED", 5)
    shifts = {"far": {"start_range": (900e3, 950e3)}, "none": {}}
    found = shift.play("KershawEvansPosition", shifts, jobs=1)
    for half in (shift.KNOWN, shift.UNKNOWN):
        far, none = (found[name][half]["policies"] for name in ("far", "none"))
        assert far["ppo"]["outside"] > 0.9
        assert none["ppo"]["outside"] < 0.1
        assert far["best-simple"]["outside"] is None
    line = next(line for line in shift.tables({"KershawEvansPosition": found}).splitlines() if " far |" in line)
    assert line.split("|")[-3].strip() == f"{100.0 * found['far'][shift.KNOWN]['policies']['ppo']['outside']:.0f} %"
    before = found["far"][shift.KNOWN]["policies"]["ppo"].pop("belief")
    found["far"][shift.KNOWN]["policies"]["ppo"]["outside"] = None
    shift.count_outside("KershawEvansPosition", shifts, found, jobs=1)
    again = found["far"][shift.KNOWN]["policies"]["ppo"]
    assert again["outside"] > 0.9
    assert "belief" not in again, "nothing else is played"
    assert before


@pytest.mark.slow
def test_a_shift_of_which_the_tracker_does_not_know_shows_in_truth_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(shift, "WORLDS", 16)
    monkeypatch.setattr(shift, "SAVED", tmp_path)
    monkeypatch.setattr(KershawEvansPosition, "nees_dimension", 2)
    found = shift.play("KershawEvansPosition", {"rough": {"q": 10_000.0}, "none": {}}, jobs=1)
    flags = {
        (name, half): figures["policies"]["best-simple"]["nees"]["flag"]
        for name, halves in found.items()
        for half, figures in halves.items()
    }
    assert flags == {
        ("rough", "known"): "",
        ("rough", "unknown"): "high",
        ("none", "known"): "",
        ("none", "unknown"): "",
    }
    without_change = found["none"]["unknown"]["policies"]
    del without_change["best-planner"]
    assert found["none"]["known"]["policies"] == without_change
    assert " high |" in shift.tables({"KershawEvansPosition": found}).partition("does not know")[2]


def test_a_parameter_in_which_the_truth_may_not_differ_is_known_to_the_tracker() -> None:
    system = KershawEvansPosition()
    assert shift.halves(system, {"q": 1.0}) == {"known": {"q": 1.0}, "unknown": {"truth": {"q": 1.0}}}
    assert shift.halves(system, {"q": 1.0, "horizon": 9}) == {"known": {"q": 1.0, "horizon": 9}}


def test_results_of_an_earlier_version_are_to_be_played_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "Urban.json").write_text('{"clutter x4": {"myopic": {"percent": 0.0}}}')
    monkeypatch.setattr(shift, "FOLDER", tmp_path)
    with pytest.raises(
        InputError, match=r"Urban\.json does not tell .* expected it from `python -m agents.distribution"
    ):
        shift.renew(["Urban"])


def test_a_broken_file_is_named(tmp_path: Path) -> None:
    file = tmp_path / "experiments.toml"
    for text in ("[A]\nx = ", '[A]\nenv = "wavegym/Urban-v0"\nshift = {}\n'):
        file.write_text(text)
        with pytest.raises(InputError, match=r"experiments\.toml: "):
            load_experiments(file)
