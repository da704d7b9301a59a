"""Signal level of the urban loop: measurements are peaks of simulated array signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from wavegym.core.arrays import Array
from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.sensors.fluctuation import realised_snr
from wavegym.sensors.multistatic import Multistatic
from wavegym.sensors.multistatic_kernels import snr_at
from wavegym.sensors.receiver import ArrayReceiver, Peaks
from wavegym.sensors.receiver_kernels import add_noise
from wavegym.systems.urban.state import Scene
from wavegym.waveforms import SPEED_OF_LIGHT

FRAMES = 30  # trains recorded without targets; their mean is subtracted
STATIC = 100.0  # power of the echo of a tree or a wall relative to a target at the same place
NOISE = 20_000  # number of the noise stream of a scan, beyond those of all paths
BACKGROUND = 30_000  # number of the stream of the recorded background, beyond those of all scans


@dataclass(frozen=True)
class UrbanReceivers:
    """Receivers that simulate and process the signals of a scene.

    Args:
        pairs: each transmitter with each receiver.
        scene: targets and their propagation paths.
        arrays: signal chain of each waveform.
        snr: eta of each waveform at 100 m, (waveform,).
        density: noise peaks above the threshold, per (m x m/s).
        fluctuation: of the echo of each path from scan to scan, see ``wavegym.sensors.fluctuation``.
    """

    pairs: Sequence[Multistatic]
    scene: Scene
    arrays: Sequence[ArrayReceiver]
    snr: Array
    density: float
    fluctuation: str = "swerling0"

    @cached_property
    def thresholds(self) -> list[float]:
        """Peak threshold of each waveform, in units of the noise power."""
        return [array.threshold(self.density) for array in self.arrays]

    def measure(self, keys: Array, scans: Array, targets: Array, sent: Array, z: Array, R: Array, count: Array) -> None:
        """One scan of every environment, as ``kernels.measure``: z (env, pair, most, m), count (env, pair).

        targets: (env, target, 6). sent: index of the waveform that the transmitter of each pair sends, (env, pair).
        R (env, pair, most, m, m) receives the covariances that are fitted to the peaks. A peak that is higher than that
        of a direct path of its range has the covariance at the SNR of that path: noise has raised it, and of the echoes
        near the threshold only those that noise raises are detected.
        """
        size = z.shape[3]
        for e, (key, scan) in enumerate(zip(keys, scans, strict=True)):
            for m in range(len(self.pairs)):
                found = self.scan(key, scan, targets[e], sent[e, m], m)
                number = min(len(found.z), z.shape[2])
                z[e, m, :number], count[e, m] = found.z[:number, :size], number
                expected = snr_at(found.z[:number, 0], self.snr[sent[e, m]], 1.0)
                raised = np.maximum(found.snr[:number] / expected, 1.0)
                R[e, m, :number] = raised[:, None, None] * found.R[:number, :size, :size]

    def scan(self, key: np.uint64, scan: int, targets: Array, waveform: int, m: int) -> Peaks:
        """Measurements of pair m in one scan of one environment with the targets (target, 6)."""
        array = self.arrays[waveform]
        image = array.image(self.samples(key, scan, targets, waveform, m) - self.background(key, waveform, m))
        return array.peaks(image, self.thresholds[waveform])

    def samples(self, key: np.uint64, scan: int, targets: Array, waveform: int, m: int) -> NDArray[np.complex128]:
        """Samples at the receiver of pair m in one scan: targets, static echoes, noise; (pulse, element, sample).

        An echo has the mean SNR of the measurement level. Phase and fluctuation are new in every scan, for every path.
        """
        array, pair, own = self.arrays[waveform], self.pairs[m], _stream(key, scan, m)
        visible = self.scene.path_count[m, scan]
        target, slot = np.nonzero(np.arange(self.scene.path_index.shape[-1]) < visible[:, None])
        path = self.scene.path_index[m, scan, target, slot]
        delays = pair.delays(targets[target], path, array.times, array.offsets)
        r = 0.5 * SPEED_OF_LIGHT * delays.mean(axis=(1, 2))
        received = r <= array.reach
        target, slot, delays = target[received], slot[received], delays[received]
        eta = snr_at(r[received], self.snr[waveform], self.scene.reflected[m, scan, target, slot])
        numbers = target * self.scene.path_index.shape[-1] + slot
        phases, draws = ([uniform(_stream(own, number), i) for number in numbers] for i in (0, 1))
        eta = realised_snr(draws, eta, self.fluctuation)
        amplitudes = np.sqrt(0.5 * eta) * np.exp(2j * np.pi * np.array(phases))
        samples = array.receive(delays, amplitudes) + self._static_echoes[waveform][m]
        add_noise(_stream(own, NOISE), 1.0, samples.reshape(-1))
        return samples

    def background(self, key: np.uint64, waveform: int, m: int) -> NDArray[np.complex128]:
        """Mean over all pulses of the frames recorded without targets, (element, sample).

        The paper subtracts mean magnitudes of images; a mean of complex samples keeps a target that coincides with the
        echo of a wall.
        """
        mean = self._static_echoes[waveform][m].copy()
        own = _stream(key, BACKGROUND, waveform, m)
        add_noise(own, (FRAMES * self.arrays[waveform].train.count) ** -0.5, mean.reshape(-1))
        return mean

    @cached_property
    def _static_echoes(self) -> list[list[NDArray[np.complex128]]]:
        """Echoes of walls and trees for one pulse of each waveform, of each pair, (element, sample)."""
        return [
            [_static_echoes(array, pair, snr) for pair in self.pairs]
            for array, snr in zip(self.arrays, self.snr, strict=True)
        ]


def _static_echoes(array: ArrayReceiver, pair: Multistatic, snr: float) -> NDArray[np.complex128]:
    echoes = pair.background()
    near = echoes.r <= array.reach
    elements = np.array(pair.receiver.position) + array.offsets[:, None] * np.array(pair.receiver.axis)
    middle = np.linalg.norm(echoes.source - np.array(pair.receiver.position), axis=1)
    back = np.linalg.norm(echoes.source[:, None] - elements, axis=2)
    delays = (2.0 * echoes.r[:, None] - middle[:, None] + back)[near] / SPEED_OF_LIGHT
    amplitudes = np.sqrt(0.5 * STATIC * snr_at(echoes.r, snr, echoes.reflected))[near]
    every = np.broadcast_to(delays[:, None], (len(delays), array.train.count, array.elements))
    return array.receive(every, amplitudes)[0]


def _stream(key: np.uint64, *numbers: int) -> np.uint64:
    """A nested random stream; compiled code returns Python integers, which have to be made unsigned again."""
    for number in numbers:
        key = np.uint64(stream(key, number))
    return key
