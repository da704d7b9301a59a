"""The street's signal level: what receivers measure is found in what their elements sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from wavegym.core.arrays import Array
from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.sensors.multistatic import Multistatic
from wavegym.sensors.receiver import ArrayReceiver, Peaks
from wavegym.sensors.receiver_kernels import add_noise
from wavegym.systems.urban.state import Scene
from wavegym.trackers.urban.kernels import snr_at
from wavegym.waveforms import SPEED_OF_LIGHT

FRAMES = 30  # recorded of the empty street, each a train, whose mean is subtracted
STANDING = 100.0  # power of what a tree or a wall returns over that of a target in its place
NOISE = 20_000  # number of a stream within a scan's, beyond those of all ways
EMPTY_STREET = 30_000  # and of one beside the scans'


@dataclass(frozen=True)
class StreetReceivers:
    """Receivers in a street with all that they may have to process.

    Args:
        pairs: each transmitter with each receiver.
        scene: what happens.
        arrays: each waveform's signal chain.
        snr: eta of each waveform at 100 m, (waveform,).
        density: peaks of noise that the threshold lets through, per (m x m/s).
    """

    pairs: Sequence[Multistatic]
    scene: Scene
    arrays: Sequence[ArrayReceiver]
    snr: Array
    density: float

    @cached_property
    def thresholds(self) -> list[float]:
        """Each waveform's, of peaks in units of the noise's power."""
        return [array.threshold(self.density) for array in self.arrays]

    def measure(self, keys: Array, scans: Array, sent: Array, z: Array, count: Array) -> None:
        """One scan of every environment, as ``urban_kernels.measure``: z (env, pair, most, 2), count (env, pair).

        sent: number of the waveform that each pair's transmitter sends, (env, pair).
        """
        for e, (key, scan) in enumerate(zip(keys, scans, strict=True)):
            for m in range(len(self.pairs)):
                found = self.scan(key, scan, sent[e, m], m).z[: z.shape[2]]
                z[e, m, : len(found)], count[e, m] = found, len(found)

    def scan(self, key: np.uint64, scan: int, waveform: int, m: int) -> Peaks:
        """What the m-th pair measures in one scan of one environment."""
        array = self.arrays[waveform]
        image = array.image(self.samples(key, scan, waveform, m) - self.street(key, waveform, m))
        return array.peaks(image, self.thresholds[waveform])

    def samples(self, key: np.uint64, scan: int, waveform: int, m: int) -> NDArray[np.complex128]:
        """What the m-th pair's receiver samples in one scan: targets, the street, noise; (pulse, element, sample).

        An echo has the SNR that the measurement level's errors are for, and a phase of its own in every scan.
        """
        array, pair, own = self.arrays[waveform], self.pairs[m], _stream(key, scan, m)
        ways = self.scene.ways[m, scan]
        target, slot = np.nonzero(np.arange(self.scene.way.shape[-1]) < ways[:, None])
        r, reflected = (of[m, scan, target, slot] for of in (self.scene.z[..., 0], self.scene.reflected))
        received = r <= array.reach
        target, slot, eta = target[received], slot[received], snr_at(r, self.snr[waveform], reflected)[received]
        delays = pair.delays(
            self.scene.truth[scan, target], self.scene.way[m, scan, target, slot], array.times, array.offsets
        )
        turns = [uniform(_stream(own, number), 0) for number in target * self.scene.way.shape[-1] + slot]
        amplitudes = np.sqrt(0.5 * eta) * np.exp(2j * np.pi * np.array(turns))
        samples = array.receive(delays, amplitudes) + self._standing[waveform][m]
        add_noise(_stream(own, NOISE), 1.0, samples.reshape(-1))
        return samples

    def street(self, key: np.uint64, waveform: int, m: int) -> NDArray[np.complex128]:
        """Mean of the frames, and of their pulses, that were recorded of the empty street, (element, sample).

        The paper subtracts mean magnitudes of images; with complex samples a target is not lost where it meets a wall.
        """
        mean = self._standing[waveform][m].copy()
        own = _stream(key, EMPTY_STREET, waveform, m)
        add_noise(own, (FRAMES * self.arrays[waveform].train.count) ** -0.5, mean.reshape(-1))
        return mean

    @cached_property
    def _standing(self) -> list[list[NDArray[np.complex128]]]:
        """What walls and trees return of one pulse of each waveform to each pair, (element, sample)."""
        return [
            [_standing(array, pair, snr) for pair in self.pairs]
            for array, snr in zip(self.arrays, self.snr, strict=True)
        ]


def _standing(array: ArrayReceiver, pair: Multistatic, snr: float) -> NDArray[np.complex128]:
    echoes = pair.background()
    near = echoes.r <= array.reach
    elements = np.array(pair.receiver.position) + array.offsets[:, None] * np.array(pair.receiver.axis)
    middle = np.linalg.norm(echoes.source - np.array(pair.receiver.position), axis=1)
    back = np.linalg.norm(echoes.source[:, None] - elements, axis=2)
    delays = (2.0 * echoes.r[:, None] - middle[:, None] + back)[near] / SPEED_OF_LIGHT
    amplitudes = np.sqrt(0.5 * STANDING * snr_at(echoes.r, snr, echoes.reflected))[near]
    every = np.broadcast_to(delays[:, None], (len(delays), array.train.count, array.elements))
    return array.receive(every, amplitudes)[0]


def _stream(key: np.uint64, *numbers: int) -> np.uint64:
    """A stream within a stream; compiled code gives back Python's integers, which it does not take for unsigned."""
    for number in numbers:
        key = np.uint64(stream(key, number))
    return key
