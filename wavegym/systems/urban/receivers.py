"""Signal level of the urban loop: measurements are peaks of simulated array signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wavegym.core.arrays import Array
from wavegym.sensors.detection import realised_snr
from wavegym.sensors.multistatic import Multistatic
from wavegym.sensors.receiver import ArrayReceiver, Peaks
from wavegym.systems.urban import kernels
from wavegym.systems.urban.state import Scene
from wavegym.waveforms import SPEED_OF_LIGHT

FRAMES = 30  # trains recorded without targets; their mean is subtracted


@dataclass(frozen=True)
class UrbanReceivers:
    """Receivers that simulate and process the signals of a scene.

    Each receiver subtracts the mean of ``FRAMES`` trains that it recorded without targets. Walls and trees do not move,
    so their echoes cancel and are never computed. The noise of the recording remains. The paper subtracts mean
    magnitudes of images. A mean of complex signals preserves a target that coincides with the echo of a wall.

    Args:
        pairs: all pairs of a transmitter and a receiver.
        scene: targets and their propagation paths.
        arrays: signal chain of each waveform.
        snr: eta of each waveform at 100 m, (waveform,).
        density: expected noise peaks above the threshold, per (m x m/s).
        fluctuation: model of the fluctuation of each path's echo from scan to scan, see ``wavegym.sensors.detection``.
        rate_floor: standard deviation of each path's range-rate from scan to scan about that of its target, m/s.
    """

    pairs: Sequence[Multistatic]
    scene: Scene
    arrays: Sequence[ArrayReceiver]
    snr: Array
    density: float
    fluctuation: str = "swerling0"
    rate_floor: float = 0.0

    @cached_property
    def thresholds(self) -> list[float]:
        """Peak threshold of each waveform, in units of the noise power."""
        return [array.threshold(self.density) for array in self.arrays]

    def measure(self, keys: Array, scans: Array, targets: Array, sent: Array, z: Array, R: Array, count: Array) -> None:
        """One scan of every environment, as ``kernels.measure``: z (env, pair, most, m), count (env, pair).

        targets: (env, target, 6). sent: index of the waveform that the transmitter of each pair sends, (env, pair).
        R (env, pair, most, m, m) is filled with the covariances of the fits to the peaks, see ``kernels.report``.
        """
        factors = self._factors(keys, scans)
        for e, (key, scan) in enumerate(zip(keys, scans, strict=True)):
            for m in range(len(self.pairs)):
                waveform = sent[e, m]
                outputs = self._outputs(key, scan, targets[e], waveform, m, factors[e, m])
                found = self._peaks(outputs, waveform)
                steady = self.fluctuation == "swerling0"
                count[e, m] = kernels.report(*found, self.snr[waveform], steady, z[e, m], R[e, m])

    def scan(self, key: np.uint64, scan: int, targets: Array, waveform: int, m: int) -> Peaks:
        """Peaks of pair m in one scan of one environment with the targets (target, 6)."""
        return self._peaks(self.outputs(key, scan, targets, waveform, m), waveform)

    def outputs(self, key: np.uint64, scan: int, targets: Array, waveform: int, m: int) -> Array:
        """Outputs of the matched filters of pair m in one scan, minus the mean of the recording.

        An echo has the same mean SNR as at the measurement level. Each path has a new phase and amplitude in each scan.

        Returns:
            (pulse, element, 2, delay cell), as ``ArrayReceiver.receive``.
        """
        factors = self._factors(np.array([key]), np.array([scan]))[0, m]
        return self._outputs(key, scan, targets, waveform, m, factors)

    def _factors(self, keys: Array, scans: Array) -> Array:
        """Ratio of each path's SNR to its mean in one scan of each environment, (env, pair, target x slot)."""
        _, _, targets, slots = self.scene.path_index.shape
        draws = np.empty((len(keys), len(self.pairs), targets * slots))
        kernels.fluctuation_draws(keys, scans, draws)
        return realised_snr(draws, 1.0, self.fluctuation)

    def _outputs(self, key: np.uint64, scan: int, targets: Array, waveform: int, m: int, factors: Array) -> Array:
        array, outputs = self.arrays[waveform], np.zeros(self.arrays[waveform].shape)
        kernels.receive_targets(
            key, scan, m, targets, self.scene, factors, self.snr[waveform], array.reach, self.rate_floor,
            array.offsets, array.times, SPEED_OF_LIGHT, array.echo_law, outputs,
        )  # fmt: skip
        kernels.receive_noise(key, scan, m, waveform, FRAMES, array.noise_law, outputs)
        return outputs

    def _peaks(self, outputs: Array, waveform: int) -> Peaks:
        array = self.arrays[waveform]
        return array.measured(array.transform(outputs), self.thresholds[waveform])
