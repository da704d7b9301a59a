"""What the choice of a waveform is worth among scatterers: ``python -m agents.clutter``.

Two radars choose among trains of sixteen pulses at three intervals, in ground, sea and rain clutter and without
clutter. The one-step scheduler plays with all of them, with each alone, with one after another as a radar that staggers
its intervals, and with those that receive least clutter at the predicted targets. It also plays with one threshold, and
with a threshold that each radar chooses with its train. Results are written to results/clutter.json, table and picture
to docs/clutter.md. ``--tables`` renews the page without playing.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from agents import blocks
from agents.leaderboard import ROOT
from wavegym.core.action_sets import Library
from wavegym.core.arrays import Array
from wavegym.core.command_line import Parser, guarded
from wavegym.core.files import write_whole
from wavegym.core.system import System
from wavegym.evaluation import compare
from wavegym.evaluation.comparison import BASELINE, Comparison
from wavegym.evaluation.picture import as_png
from wavegym.evaluation.table import interval, number, signed, tabulated
from wavegym.schedulers import Myopic
from wavegym.sensors import range_and_rate
from wavegym.sensors.scatterers import KINDS, clutter_power
from wavegym.sensors.scatterers_kernels import ClutterField, noise_with_clutter
from wavegym.waveforms import PulseTrain, TrapezoidChirp

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RESULTS, PAGE = ROOT / "results" / "clutter.json", ROOT / "docs" / "clutter.md"
START, END = "<!-- made by `python -m agents.clutter`: -->", "<!-- clutter to here -->"
PICTURE = ROOT / "docs" / "images" / "clutter.png"
WORLDS, SEED, JOBS = 300, 0, 2
PULSES, DURATION, SWEEP = 16, 3e-6, 5e6
BEAMS, SCANS = (213e-6, 250e-6, 300e-6), (150e-6, 160e-6, 172e-6)  # intervals of the two systems, s
ALARMS, THRESHOLDS = (0.05, 0.01, 1e-3, 1e-4), "AgileClutter, thresholds"
DETERMINANT = "myopic:determinant"
CARRIER_HZ, RANGE = 10.4e9, 20e3  # of the picture


class GivenTrains(Myopic):
    """The one-step scheduler with trains that another rule chooses."""

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        self._every = self._system.candidates()
        rows, windows = self._system.action_set.windows(self._every)
        self._sent = windows[rows, -1].astype(np.int64)  # (candidate, sensor)
        self._count = len(self._system.action_set.waveforms)

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        return super().act(belief, observation, (self._sent == self.trains(belief)).all(axis=2))

    def trains(self, belief: Any) -> Array:
        """Number of each radar's train, (env, candidate or 1, sensor or 1)."""
        raise NotImplementedError


class OneTrain(GivenTrains):
    """Always the same train, or the trains in turn.

    Args:
        number: of the train; None for one after another, the same at all radars.
    """

    def __init__(self, number: int | None) -> None:
        super().__init__()
        self.number = number

    def trains(self, belief: Any) -> Array:
        """See ``GivenTrains``."""
        now = belief.step % self._count if self.number is None else np.full(len(belief.step), self.number)
        return now[:, None, None]


class LeastClutter(GivenTrains):
    """The train that receives least clutter at the predicted ranges and range-rates of the targets in the beam."""

    def trains(self, belief: Any) -> Array:
        """See ``GivenTrains``."""
        mean = self._system.predicted_targets(belief).mean  # (env, target, 4)
        r, v = np.moveaxis(range_and_rate(mean[:, None], np.array(self._system.sensors)[:, None]), -1, 0)
        power = received(self._system.clutter_field, np.arange(self._count), r[..., None], v[..., None])
        lit = self._system.pulse(belief, self._every[None]).chance  # (env or 1, candidate, sensor, target)
        return np.einsum("ecst,estw->ecsw", np.broadcast_to(lit, (len(mean), *lit.shape[1:])), power).argmin(axis=3)


@np.vectorize(excluded={0})
def received(field: ClutterField | None, train: int, r: float, v: float) -> float:
    """Power of noise and clutter of mean texture in a train's filter, over that of noise."""
    return float(noise_with_clutter(field, train, r, v, 0.5))


def systems() -> dict[str, dict[str, Any]]:
    """Parameters of each system with trains."""
    pulse = TrapezoidChirp(kind="pfm", duration=DURATION, sweep=SWEEP)
    trains = Library(tuple(PulseTrain(pulse, count=PULSES, interval=each) for each in SCANS))
    same = {"durations": (DURATION,), "sweeps": (SWEEP,), "counts": (PULSES,)}
    beams = {name: values * len(BEAMS) for name, values in same.items()} | {"intervals": BEAMS}
    return {"BeamAllocation": beams, "AgileClutter": {"library": trains}}


def play(name: str, parameters: Mapping[str, Any], kind: str | None) -> dict[str, Any]:
    """The schedulers in one system and kind of clutter."""
    intervals = BEAMS if name == "BeamAllocation" else SCANS
    fixed = {f"{1e6 * each:g} us": OneTrain(n) for n, each in enumerate(intervals)}
    policies: dict[str, Any] = {BASELINE: None, DETERMINANT: None, "least clutter": LeastClutter()}
    policies |= {"in turn": OneTrain(None), **fixed}
    played = _compared(name, policies, scatterers=kind, **parameters)
    return {each: _figures(played, each) for each in policies}


def play_thresholds(kind: str | None) -> dict[str, Any]:
    """AgileClutter's radars with one threshold each, against radars that choose it with their train."""
    given: dict[str, dict[str, Any]] = {BASELINE: {"false_alarms": ALARMS}}
    given |= {f"Pf {alarm:g}": {"false_alarm": alarm} for alarm in ALARMS}
    same = {"scatterers": kind, **systems()["AgileClutter"]}
    runs = {name: _compared("AgileClutter", {BASELINE: None}, **same, **more) for name, more in given.items()}
    merged = replace(runs[BASELINE], played={name: run.played[BASELINE] for name, run in runs.items()})
    return {name: _figures(merged, name) for name in runs}


def _compared(name: str, policies: Mapping[str, Any], **parameters: Any) -> Comparison:
    common: dict[str, Any] = {"worlds": WORLDS, "seed": SEED, "jobs": JOBS, "progress": False}
    return compare(f"wavegym/{name}-v0", policies, **common, **parameters)


def _figures(played: Comparison, name: str) -> dict[str, Any]:
    """Mean cost, NEES, and the geometric mean of the ratios to the one-step scheduler, in per cent."""
    halves = {by: played.against(name, by=by)._asdict() for by in ("belief", "truth")}
    nees, lost = (float(np.mean([getattr(member, key) for member in played.played[name]])) for key in ("nees", "lost"))
    return {"cost": float(played.cost(name).mean()), "nees": nees, "lost": lost, **halves}


def table(results: Mapping[str, Any]) -> str:
    """A line for each system, kind of clutter and policy."""
    rows = []
    for place, policies in results.items():
        for name, figures in policies.items():
            row = [*place.split("/"), name, number(figures["cost"])]
            for by in ("belief", "truth"):
                row += [signed(figures[by]["value"]), interval(figures[by]["ci"], signed)]
            rows.append([*row, f"{figures['nees']:.2f}", f"{figures['lost']:.2f}"])
    head = ["system", "clutter", "policy", "mean cost", "belief %", "95 %", "truth %", "95 %", "NEES", "lost"]
    return tabulated(head, rows)


def picture() -> bytes:
    """c(v) of the trains of BeamAllocation in each kind of clutter, and what the best of the three leaves."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 6.5), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, kind in zip(figure.subplots(len(KINDS), 1, sharex=True, sharey=True), KINDS, strict=True):
        _draw(axes, kind)
    axes.set_xlabel("range-rate of the filter [m/s]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize="small")
    return as_png(figure)


def _draw(axes: Axes, kind: Any) -> None:
    """Loss of SNR by one kind of clutter."""
    pulse, rates = TrapezoidChirp(kind="pfm", duration=DURATION, sweep=SWEEP), np.linspace(-10.0, 150.0, 801)
    trains = [PulseTrain(pulse, count=PULSES, interval=each) for each in BEAMS]
    lost = [10.0 * np.log10(1.0 + clutter_power(KINDS[kind], train, CARRIER_HZ, RANGE, rates)[0]) for train in trains]
    for each, loss in zip(BEAMS, lost, strict=True):
        axes.plot(rates, loss, linewidth=0.8, label=f"every {1e6 * each:g} us")
    axes.plot(rates, np.min(lost, axis=0), color="black", linewidth=1.5, label="the best of the three")
    axes.set(ylabel=f"{kind} [dB]")


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.clutter", description="What choosing a train is worth among scatterers.")
    parser.add_argument("--tables", action="store_true", help="renew the page from earlier results; play nothing")
    results = blocks.read_results(RESULTS)
    if not parser.read(None).tables:
        kinds: dict[str, str | None] = {"none": None, **{kind: kind for kind in KINDS}}
        results = {
            f"{name}/{label}": play(name, parameters, kind)
            for name, parameters in systems().items()
            for label, kind in kinds.items()
        }
        results |= {f"{THRESHOLDS}/{label}": play_thresholds(kind) for label, kind in kinds.items()}
        write_whole(RESULTS.parent, {RESULTS.name: (json.dumps(results, indent=1) + "\n").encode()})
    blocks.renew(PAGE, START, END, table(results))
    write_whole(PICTURE.parent, {PICTURE.name: picture()})


if __name__ == "__main__":
    sys.exit(guarded(main))
