"""No number changes unnoticed: tapes exactly, costs to 1e-9 (processors differ), saved agents alike."""

from __future__ import annotations

import json
from pathlib import Path

import golden
import numpy as np
import pytest

RECORDED = json.loads(Path(__file__).with_name("golden.json").read_text("utf-8"))
QUICK = ("random", "round-robin", "myopic", "best-simple")
FEW = 2  # worlds of the quick test; the slow one plays the agents
NETWORK = 1e-6  # a network is float32: on another processor its point of a box differs by some 1e-7
# Sectors that look alike have scores that differ in the last bits only. On another processor another one comes first,
# and all that follows differs: by up to 5 % in three worlds of 400 dwells.
TIES = {"MultifunctionRadar-v1": 0.2}


def close(got: list[str], want: list[str], rtol: float = 1e-9) -> None:
    played, recorded = ([float.fromhex(cost) for cost in costs] for costs in (got, want))
    np.testing.assert_allclose(played, recorded[: len(played)], rtol=rtol)


@pytest.mark.parametrize("name", RECORDED)
def test_tapes_and_costs_are_those_recorded(name):
    policies = QUICK[:3] if RECORDED[name]["settings"] else QUICK  # other parameters would be tuned for anew
    found = golden.record(name, policies, FEW, saved=0)
    assert found["tape"] == RECORDED[name]["tape"]
    for policy, costs in found["costs"].items():
        close(costs, RECORDED[name]["costs"][policy])


@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDED)
def test_saved_agents_play_as_recorded(name):
    found = golden.record(name, ("random",), 1)
    assert found["saved"].keys() == RECORDED[name]["saved"].keys()
    for agent, costs in found["saved"].items():
        close(costs, RECORDED[name]["saved"][agent], TIES.get(name, NETWORK))


def test_every_environment_is_recorded():
    import wavegym

    ids = {id for id in wavegym.list_envs() if id.startswith("wavegym/")}
    renew = "python tests/golden.py record tests/golden.json records a new environment"
    assert {f"wavegym/{name}" for name in RECORDED} == ids, renew


def test_a_changed_tape_or_cost_is_noticed():
    worlds = (np.zeros(3), np.ones(2))
    assert golden.digest(worlds) != golden.digest((np.zeros(3), np.array([1.0, np.nextafter(1.0, 2.0)])))
    assert golden.digest(worlds) != golden.digest((np.zeros(3, np.float32), np.ones(2)))
    with pytest.raises(AssertionError):
        close([(1.0).hex()], [(1.0 + 1e-8).hex()])
