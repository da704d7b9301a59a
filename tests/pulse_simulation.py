"""Independent simulation of pulses: samples of the receive window, matched filters, maximum likelihood.

The echo is A s(t - tau) exp(j 2 pi nu t) where the receiver is open, plus complex white noise of power N0 = 1 per
hertz. Samples are the midpoints of cells, and receive windows end at borders of cells. Nothing here knows of Fisher
information or of moments.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wavegym.waveforms import PulseTrain, Waveform


class Receiver(NamedTuple):
    """Sample times of the open receiver, the same around every pulse's echo, and the pulses' centres."""

    inside: NDArray  # (sample,) after a pulse's centre, s
    dt: float
    pulse: Waveform  # the single pulse
    starts: NDArray  # (pulse,) centres of the transmitted pulses, s

    def echo(self, delay: NDArray, doppler: NDArray) -> NDArray:
        """Samples of an echo of unit energy (if it were whole), (trial, sample)."""
        one = self.pulse.signal(self.inside - delay[:, None]) * np.exp(2j * np.pi * doppler[:, None] * self.inside)
        turns = np.exp(2j * np.pi * doppler[:, None] * self.starts)
        return (turns[:, :, None] * one[:, None]).reshape(len(delay), -1) / np.sqrt(len(self.starts))

    def noise(self, rng: np.random.Generator, trials: int) -> NDArray:
        """White noise of one unit per hertz, (trial, sample)."""
        draws = rng.standard_normal((2, trials, len(self.starts) * len(self.inside)))
        return (draws[0] + 1j * draws[1]) * np.sqrt(0.5 / self.dt)


def receiver(waveform: Waveform, delay: float, windows, samples: int) -> Receiver:
    """A receiver that is open in ``windows`` (low, high) of absolute time relative to each pulse's centre.

    Only the part of a window that may hold the echo is sampled, ``samples`` cells over the pulse's support.
    """
    train = waveform if isinstance(waveform, PulseTrain) else None
    pulse = train.pulse if train else waveform
    count = train.count if train else 1
    starts = (np.arange(count) - (count - 1) / 2) * (train.interval if train else 0.0)
    begins, ends = pulse.support
    dt = (ends - begins) / samples
    times = []
    for low, high in windows:
        first, last = max(low, begins + delay - 40 * dt), min(high, ends + delay + 40 * dt)
        if first >= last:
            continue
        anchor, sign = (low, 1.0) if np.isfinite(low) and first == low else (high, -1.0)
        if not np.isfinite(anchor) or (sign < 0 and last != high):
            anchor, sign = first, 1.0
        cells = int(np.ceil((last - first) / dt))
        cells = round((last - first) / dt) if first == low and last == high else cells
        times.append(anchor + sign * dt * (np.arange(cells) + 0.5))
    return Receiver(np.sort(np.concatenate(times)), dt, pulse, starts)


def maximum_likelihood(radar: Receiver, y: NDArray, delay: NDArray, doppler: NDArray, scale: tuple[float, float]):
    """Maximise |<y, s>|^2/<s, s> over delay and Doppler, by Gauss-Newton with unknown complex amplitude, (trial,).

    ``scale``: steps of the numerical derivatives in delay and Doppler. Iterations start at ``delay``, ``doppler``.
    """
    for _ in range(6):
        s = radar.echo(delay, doppler)
        energy = (np.abs(s) ** 2).sum(axis=1)
        amplitude = (np.conj(s) * y).sum(axis=1) / energy
        columns = []
        for dtau, dnu in ((scale[0], 0.0), (0.0, scale[1])):
            ahead, behind = radar.echo(delay + dtau, doppler + dnu), radar.echo(delay - dtau, doppler - dnu)
            d = amplitude[:, None] * (ahead - behind) / 2  # per step
            columns.append(d - s * ((np.conj(s) * d).sum(axis=1) / energy)[:, None])
        rest = y - amplitude[:, None] * s
        normal = np.array([[(np.conj(a) * b).sum(axis=1).real for b in columns] for a in columns])
        right = np.array([(np.conj(a) * rest).sum(axis=1).real for a in columns])
        step = np.linalg.solve(normal.transpose(2, 0, 1), right.T[..., None])[..., 0]
        delay, doppler = delay + step[:, 0] * scale[0], doppler + step[:, 1] * scale[1]
    return delay, doppler


def statistic(radar: Receiver, y: NDArray, delay: NDArray, doppler: NDArray) -> NDArray:
    """|<y, s>|^2/<s, s>, the likelihood that ``maximum_likelihood`` maximises, (trial,)."""
    s = radar.echo(delay, doppler)
    return np.abs((np.conj(s) * y).sum(axis=1)) ** 2 / (np.abs(s) ** 2).sum(axis=1)
