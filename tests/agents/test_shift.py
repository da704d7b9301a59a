"""Policies in worlds that they were not made for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents import shift
from wavegym.errors import InputError
from wavegym.evaluation import make_task
from wavegym.registration import SYSTEMS

CASES = [(env, name, given) for env, shifts in shift.load_shifts().items() for name, given in shifts.items()]


@pytest.mark.parametrize(("env", "name", "given"), CASES, ids=[f"{env}: {name}" for env, name, _ in CASES])
def test_every_shift_is_another_world_that_shows_the_same_elements(env: str, name: str, given: dict) -> None:
    env_id = f"wavegym/{env}-v0"
    assert env_id in SYSTEMS
    here, there = make_task(env_id, {}).system, make_task(env_id, given).system
    assert here != there
    assert here.elements == there.elements  # or no agent could be played there


def test_rules_keep_the_constants_they_were_tuned_with(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(shift, "WORLDS", 4)
    monkeypatch.setattr(shift, "SAVED", tmp_path)
    found = shift.play("SectorSetup", {"harder": {"reference_snr": 10.0}, "none": {}}, jobs=1)
    assert found["none"]["best-simple"]["percent"] == found["harder"]["best-simple"]["percent"] == 0.0
    assert set(found["harder"]) == {"myopic", "best-simple"}
    assert found["harder"]["myopic"]["percent"] > 0.0
    assert np.isfinite(found["harder"]["myopic"]["nees"])
    text = shift.table({"SectorSetup": found})
    assert text.count("\n") == 3
    assert "| SectorSetup | harder" in text


def test_a_broken_file_is_named(tmp_path: Path) -> None:
    file = tmp_path / "shifts.toml"
    file.write_text("[A]\nx = ")
    with pytest.raises(InputError, match=r"shifts\.toml cannot be read"):
        shift.load_shifts(file)
