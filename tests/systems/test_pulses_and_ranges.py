"""Pulses of the environments against the ranges and speeds of their targets."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.core.capabilities import TimedPulses, offers
from wavegym.core.errors import InputError
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.envs.build import build_system
from wavegym.envs.describe import describe, target_extent
from wavegym.evaluation.task import make_task
from wavegym.registration import SYSTEMS
from wavegym.systems.beam_allocation.system import BeamAllocation
from wavegym.systems.kershaw_evans.system import KershawEvansPosition

TIMED = [id for id in SYSTEMS if offers(make_task(id, {}).system, TimedPulses)]
DEAF = "its long chirp lasts 2 ms, and echoes come after 70 us: to become a train together with its tables"


def impossible(system):
    """Pulses whose echo the radar's own transmission cuts, or whose range folds, somewhere in the scenario."""
    (nearest, _), (farthest, _) = target_extent(system)
    timings = system.timings.items()
    return [
        label for label, timing in timings if not timing.blind_range <= nearest <= farthest <= timing.unambiguous_range
    ]


@pytest.mark.parametrize(
    "env_id",
    [pytest.param(i, marks=pytest.mark.xfail(reason=DEAF, strict=True)) if "BeamA" in i else i for i in TIMED],
)
def test_every_pulse_can_be_sent_and_received(env_id):
    assert impossible(make_task(env_id, {}).system) == []


def test_pulses_that_cannot_be_received_are_found():
    near = KershawEvansPosition(start_range=(15e3, 25e3))
    assert len(impossible(near)) == 5 * len(near.sweeps)  # 43 us and longer, blind to 23 km and more


def test_trains_in_beam_allocation_send_the_energy_of_the_chirp_and_hear_the_nearest_target():
    system = BeamAllocation(durations=(50e-6, 6.25e-6), counts=(1, 8))
    assert impossible(system) == []
    chirp, train = system.timings.values()
    assert train.duration * train.count == pytest.approx(chirp.duration, rel=1e-9)
    assert train.coherent_processing_interval == pytest.approx(2e-3, rel=1e-12)
    with pytest.raises(InputError, match=r"durations is .*, sweeps is .*, counts is \(1,\), expected one of each"):
        build_system(BeamAllocation, {"counts": (1,)})
    with pytest.raises(InputError, match="interval"):
        build_system(BeamAllocation, {"counts": (1, 8)})  # of 2 ms pulses


def test_ranges_are_those_of_the_states():
    system = BeamAllocation(horizon=5)
    world = draw_worlds(system, world_seeds(0, "test", 3))
    found, state = system.target_ranges(world), system.initial(world)
    for k in range(5):
        for i, (x, y) in enumerate(system.sensors):
            at = state.truth.targets - [x, y, 0.0, 0.0]
            r = np.hypot(at[..., 0], at[..., 1])
            np.testing.assert_allclose(found[:, :, k, i, 0], r, rtol=1e-12)
            rate = (at[..., 0] * at[..., 2] + at[..., 1] * at[..., 3]) / r
            np.testing.assert_allclose(found[:, :, k, i, 1], rate, rtol=1e-9, atol=1e-9)
        state = system.transition(state, np.zeros(3, np.int64), world)


def test_the_page_groups_pulses_of_one_timing():
    page = describe("KershawEvans-v0")
    rows = [
        line for line in page[page.index("## Timing") : page.index("## Observations")].splitlines() if " more |" in line
    ]
    assert len(rows) == 8  # durations
    assert "| unmodulated 300 us and 10 more | 1093 | 163.8 | none | none |" in rows[-1]
