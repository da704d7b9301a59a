"""Waveforms that several tests share: random waveforms, and a chirp with kinks and without a closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from wavegym.waveforms import GaussianChirp, PulseTrain, Waveform

durations = st.floats(-7, -3).map(lambda e: 10.0**e)
directions = st.sampled_from(["up", "down"])


@st.composite
def chirps(draw, largest_product=1e4):
    """Gaussian chirps; the time-bandwidth product g k^2 is 0 or spans decades."""
    k = draw(durations)
    product = draw(st.one_of(st.just(0.0), st.floats(-3, np.log10(largest_product)).map(lambda e: 10.0**e)))
    return GaussianChirp(duration=k, chirp_rate=product / (k * k), direction=draw(directions))


@st.composite
def trains(draw, largest_product=1e3):
    pulse = draw(chirps(largest_product))
    return PulseTrain(pulse, count=draw(st.integers(1, 12)), interval=draw(st.floats(9.7, 60)) * pulse.duration)


def _lfm(u, shape):
    return u, 0.5 * u * u


def _pfm(u, shape):
    return u ** (shape - 1), u**shape / shape


def _hfm(u, shape):
    swing = shape * (shape + 1)
    return -swing / (shape + u), -swing * np.log(shape + u)


def _efm(u, shape):
    scale = 1 / (1 - np.exp(-1 / shape))
    return -scale * np.exp(-u / shape), scale * shape * np.exp(-u / shape)


FREQUENCY_LAWS = {"lfm": _lfm, "pfm": _pfm, "hfm": _hfm, "efm": _efm}
"""u in [0, 1] -> (frequency offset over the sweep, its integral over u)."""


@dataclass(frozen=True)
class KinkedChirp(Waveform):
    """Up-chirp with a trapezoid envelope (Sira et al.): duration lam, sweep D, edges lam/20."""

    law: str
    duration: float
    sweep: float
    shape: float = 0.5
    declared: bool = True  # whether `pieces` names the kinks

    @property
    def label(self):
        return self.law

    @property
    def support(self):
        return (-self.duration / 2, self.duration / 2)

    @property
    def pieces(self):
        outer, inner = self.duration / 2, 0.45 * self.duration
        return ((-outer, -inner), (-inner, inner), (inner, outer)) if self.declared else (self.support,)

    def envelope(self, t):
        edge = self.duration / 20
        flat = 0.9 * self.duration
        ramp = np.clip((self.duration / 2 - np.abs(t)) / edge, 0, 1)
        return ramp / np.sqrt(flat + 2 * edge / 3)

    def phase(self, t):
        u = np.asarray(t) / self.duration + 0.5
        return 2 * np.pi * self.sweep * self.duration * FREQUENCY_LAWS[self.law](u, self.shape)[1]
