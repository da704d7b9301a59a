"""Pulses of the environments against the ranges and speeds of their targets."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.core.system import build_system
from wavegym.core.traits import TimedPulses
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.envs.describe import describe, target_extent
from wavegym.evaluation.play import make_task
from wavegym.registration import SYSTEMS
from wavegym.schedulers.registry import make_policy
from wavegym.sensors import range_and_rate_jacobian, range_law_snr
from wavegym.systems.beam_allocation.system import BeamAllocation
from wavegym.systems.kershaw_evans.system import KershawEvansPosition

TRAIN = "8 x (PFM3 up 6.25 us 1 MHz) every 250 us"
TIMED = [id for id in SYSTEMS if isinstance(make_task(id, {}).system, TimedPulses)]


def impossible(system):
    """Pulses whose echo the radar's own transmission cuts, or whose range folds, somewhere in the scenario.

    If the PRF is chosen, one PRF must see the nearest target; the system itself handles folds.
    """
    (nearest, _), (farthest, _) = target_extent(system)
    blind = {label: 0.0 if system.bistatic else timing.blind_range for label, timing in system.timings.items()}
    if system.chooses_prf:
        return [] if min(blind.values()) <= nearest else list(blind)
    return [
        label
        for label, timing in system.timings.items()
        if not blind[label] <= nearest <= farthest <= timing.unambiguous_range
    ]


@pytest.mark.parametrize("env_id", TIMED)
def test_every_pulse_can_be_sent_and_received(env_id):
    assert impossible(make_task(env_id, {}).system) == []


def test_pulses_that_cannot_be_received_are_found():
    near = KershawEvansPosition(start_range=(15e3, 25e3))
    assert len(impossible(near)) == 5 * len(near.sweeps)  # 43 us and longer, blind to 23 km and more


def test_trains_in_beam_allocation_send_the_energy_of_the_chirp_and_fill_the_same_memory():
    system = BeamAllocation()
    chirp, train = system.timings.values()
    assert train.duration * train.count == pytest.approx(chirp.duration, rel=1e-9)
    assert train.coherent_processing_interval == pytest.approx(2e-3, rel=1e-12)
    one, several = (
        d * n * s for d, n, s in zip((50e-6, system.intervals[1]), system.counts, system.sweeps, strict=True)
    )
    assert one == pytest.approx(several, rel=1e-12)
    assert len(impossible(BeamAllocation(durations=(50e-6, 2e-3), counts=(1, 1)))) == 1
    with pytest.raises(
        InputError, match=r"durations is .*, sweeps is .*, counts is \(1,\), intervals .*, expected one"
    ):
        build_system(BeamAllocation, {"counts": (1,)})
    with pytest.raises(InputError, match="interval"):
        build_system(BeamAllocation, {"durations": (50e-6, 2e-3)})


@pytest.mark.parametrize("policy", ["best-simple", "random"])
def test_folds_of_the_trains_range_rates_lie_outside_the_gates(policy):
    """Of the predicted return, 57.7 m/s away, by the linearised innovation covariance; random play as the worst."""
    system = BeamAllocation()
    worlds = draw_worlds(system, world_seeds(0, "test", 30))
    state, looks, fold = system.initial(worlds), 0, system.timings[TRAIN].unambiguous_velocity
    played = make_policy(policy, system, worlds)
    played.begin(system, 30, np.random.default_rng(0))
    for _ in range(system.horizon):
        belief = state.belief
        action = played.act(belief, system.observe(belief), system.mask(belief))
        predicted, pulse = system.predicted_targets(belief), system.pulse(belief, action[:, None])
        for i, place in enumerate(np.array(system.sensors)):
            e, t = np.nonzero((pulse.chance[:, 0, i] > 0) & (pulse.C[:, 0, i, 1, 1] < 100.0)[:, None])  # a train's C
            x, P = predicted.mean[e, t], predicted.covariance[e, t]
            H, r = range_and_rate_jacobian(x, place), np.hypot(*(x[:, :2] - place).T)
            S = H @ P @ H.mT + pulse.C[e, 0, i] / range_law_snr(r, 50e3, 100.0)[:, None, None]
            assert (np.linalg.inv(S)[:, 1, 1] * fold**2 > system.gate**2).all()
            looks += len(e)
        state = system.transition(state, action, worlds)
    assert looks > 800


def test_receivers_of_the_street_are_antennas_of_their_own_and_its_range_rates_do_not_fold():
    system = make_task("Urban-v0", {}).system
    assert system.bistatic
    assert all(out != back for out in system.transmitters for back in system.receivers)
    (_, slowest), (_, fastest) = target_extent(system)
    assert len(system.timings) == 4
    for timing in system.timings.values():
        assert max(-slowest, fastest) < timing.unambiguous_velocity / 2
    world, scan = draw_worlds(system, world_seeds(0, "test", 2)), 45
    state = system.initial(world)
    for _ in range(scan):
        state = system.transition(state, np.zeros(2, np.int64), world)
    before = system.truth_model.scene.present[:scan].sum()
    for t, own in enumerate(np.flatnonzero(state.truth.present[0])):
        for m, receiver in enumerate(system.receivers):
            x, rates = state.truth.targets[:, own], []
            lengths = [np.linalg.norm(x[:, :2] - end, axis=1) for end in (system.transmitters[0], receiver)]
            for end, length in zip((system.transmitters[0], receiver), lengths, strict=True):
                rates.append(((x[:, :2] - end) * x[:, 2:4]).sum(axis=1) / length)
            found = system.target_ranges(world)[:, before + t, m]
            np.testing.assert_allclose(found, np.stack([sum(lengths), sum(rates)], axis=1) / 2, rtol=1e-12)


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
