"""Figures of the page on waveform timing: ``python -m agents.waveform_timing`` renews its tables and its picture.

Everything is computed from ``wavegym.waveforms`` and ``wavegym.sensors``, in seconds; nothing is played.
"""

from __future__ import annotations

import math
import sys

import numpy as np
from scipy.optimize import brentq

from agents import blocks
from agents.leaderboard import ROOT
from wavegym.core.action_sets import quantity
from wavegym.core.arrays import FloatArray
from wavegym.core.command_line import Parser, guarded
from wavegym.core.files import write_whole
from wavegym.evaluation.picture import as_png
from wavegym.evaluation.table import tabulated
from wavegym.sensors import EclipsedPulse, combined_interval
from wavegym.waveforms import GaussianChirp, PulseTiming, TrapezoidChirp, Waveform, transmitted_interval

PAGE = ROOT / "docs" / "waveform_timing.md"
PICTURE = ROOT / "docs" / "images" / "waveform_timing.png"
START, END = "<!-- made by `python -m agents.waveform_timing`: -->", "<!-- waveform timing to here -->"
CARRIER = 10e9  # Hz
LENGTH = 100e-6  # s: k of the Gaussian pulses, duration of the trapezoid chirps
INTERVAL = 1e-3  # s
SWEEP = 1e6  # Hz
DEFINITIONS: dict[str, dict[str, float]] = {
    "95 % of the energy": {"energy": 0.95},
    "99 % of the energy": {"energy": 0.99},
    "99.9 % of the energy": {"energy": 0.999},
    "above -20 dB": {"level_db": -20.0},
    "above -60 dB": {"level_db": -60.0},
}
PULSES: dict[str, Waveform] = {
    "Gaussian, up, k = 27.5 us": GaussianChirp(duration=27.5e-6, chirp_rate=1.9e10),
    "linear FM, up, 100 us": TrapezoidChirp(kind="lfm", duration=LENGTH, sweep=SWEEP),
    "hyperbolic FM, up, 100 us": TrapezoidChirp(kind="hfm", duration=LENGTH, sweep=SWEEP),
    "power FM, up, 100 us": TrapezoidChirp(kind="pfm", duration=LENGTH, sweep=SWEEP),
}
SHARES = (0.1, 0.25, 0.5, 0.75, 0.9)
PRFS = (1e3, 3e3, 10e3, 30e3, 100e3)  # Hz
DUTY = 0.1
CELL = 150.0  # m


def definitions() -> str:
    """Time on the transmitter and blind range of a pulse, for each definition of its length."""
    head = ["definition", "Gaussian pulse: in k", f"blind range, k = {LENGTH * 1e6:g} us", "trapezoid: in its duration",
            f"blind range, {LENGTH * 1e6:g} us"]  # fmt: skip
    rows = []
    for name, definition in DEFINITIONS.items():
        row = [name]
        for pulse in (GaussianChirp(duration=LENGTH), TrapezoidChirp(kind="lfm", duration=LENGTH, sweep=0.0)):
            first, last = transmitted_interval(pulse, **definition)
            blind = PulseTiming(duration=last - first, carrier_hz=CARRIER).blind_range
            row += [f"{(last - first) / LENGTH:.3f}", f"{blind / 1e3:.1f} km"]
        rows.append(row)
    return tabulated(head, rows)


def cut_pulses() -> str:
    """Standard deviations of range and range-rate relative to the whole pulse, at the same transmitted SNR."""
    head = ["pulse, visible share", *(f"{share:g}" for share in SHARES)]
    rows = []
    for name, waveform in PULSES.items():
        ratios = np.stack([_ratios(waveform, share) for share in SHARES])
        for k, measured in enumerate(("range", "range-rate")):
            rows.append([f"{name}: {measured}", *(f"{value:.3g}" for value in ratios[:, k])])
    return tabulated(head, rows)


def _ratios(waveform: Waveform, share: float) -> FloatArray:
    """(range, range-rate) of a pulse whose beginning is cut, so that this share of the energy is left."""
    eclipsed = EclipsedPulse(waveform)
    blind = eclipsed.timing(CARRIER).blind_range
    r = brentq(lambda r: float(eclipsed.visible_share(r)) - share, 0.0, blind)
    cut = np.diag(eclipsed.measurement_covariance(r, CARRIER))
    return np.sqrt(cut / np.diag(waveform.measurement_covariance(CARRIER, 1.0)))


def intervals() -> str:
    """Blind and unambiguous ranges and velocities of some PRFs, alone and with a PRF a tenth higher."""
    head = ["PRF", "pulse at 10 % duty", "blind range", "unambiguous range", "unambiguous velocity",
            f"range with a PRF of 1.1 x, cells of {CELL:g} m"]  # fmt: skip
    rows = []
    for prf in PRFS:
        timing = PulseTiming(duration=DUTY / prf, interval=1.0 / prf, count=64, carrier_hz=CARRIER, max_duty=DUTY)
        alone = timing.unambiguous_range
        both = combined_interval([alone, alone / 1.1], 0.5 * CELL, 20.0 * alone)
        rows.append(
            [
                f"{prf / 1e3:g} kHz",
                quantity(timing.duration, "s"),
                f"{timing.blind_range / 1e3:.2f} km",
                f"{alone / 1e3:.2f} km",
                f"+-{timing.unambiguous_velocity / 2:.1f} m/s",
                "-" if math.isinf(both) else f"{both / 1e3:.2f} km",
            ]
        )
    return tabulated(head, rows)


def picture() -> bytes:
    """Visible share and standard deviation of range against range, over the first interval, as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    for name, waveform in PULSES.items():
        eclipsed = EclipsedPulse(waveform, interval=INTERVAL)
        r = np.linspace(0.0, 1.15 * eclipsed.timing(CARRIER).unambiguous_range, 1200)
        left.plot(r / 1e3, eclipsed.visible_share(r), label=name)
        whole = waveform.measurement_covariance(CARRIER, 1.0)[0, 0]
        right.plot(r / 1e3, np.sqrt(eclipsed.measurement_covariance(r, CARRIER)[:, 0, 0] / whole), label=name)
    left.set(xlabel="range [km]", ylabel="visible share of the energy")
    right.set(xlabel="range [km]", ylabel="sd of range / sd of the whole pulse", yscale="log", ylim=(0.5, 300.0))
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize="small")
    return as_png(figure)


def tables() -> str:
    """The page's block of tables."""
    parts = {
        "Time on the transmitter, by definition": definitions(),
        "What a cut leaves": cut_pulses(),
        "Blind and unambiguous intervals at 10 GHz": intervals(),
    }
    return "\n\n".join(f"### {title}\n\n{table}" for title, table in parts.items())


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.waveform_timing", description="Renew the page on waveform timing.")
    parser.read(None)
    blocks.renew(PAGE, START, END, tables())
    write_whole(PICTURE.parent, {PICTURE.name: picture()})


if __name__ == "__main__":
    sys.exit(guarded(main))
