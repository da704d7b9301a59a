"""Trackers of other packages, and our own ones, as the tracker of a loop: ``gym.make(id, tracker=...)``."""

from typing import NamedTuple

import numpy as np

from wavegym.trackers import nees, predict
from wavegym.trackers.protocol import ExtendedKalman, OneByOne


class FilterpyEkf:
    """filterpy's extended Kalman filter, for one target."""

    def predict(self, x, P, motion):
        """Mean and covariance one step later."""
        kf = self._filter(x, P, len(x))
        kf.F, kf.Q = motion.F, motion.Q
        kf.predict()
        return kf.x, kf.P

    def update(self, x, P, z, R, model):
        """Mean and covariance with the measurement z."""
        kf = self._filter(x, P, len(z))
        kf.update(z, model.jacobian, model.measure, R=R)
        return kf.x, kf.P

    def _filter(self, x, P, measured):
        from filterpy.kalman import ExtendedKalmanFilter

        kf = ExtendedKalmanFilter(dim_x=len(x), dim_z=measured)
        kf.x, kf.P = x, P
        return kf


class FilterpyUkf:
    """filterpy's unscented Kalman filter, for one target."""

    def predict(self, x, P, motion):
        """Mean and covariance one step later."""
        kf = self._filter(x, P, len(x), fx=lambda s, dt: motion.F @ s, hx=None)
        kf.Q = motion.Q
        kf.predict()
        return kf.x, kf.P

    def update(self, x, P, z, R, model):
        """Mean and covariance with the measurement z."""
        kf = self._filter(x, P, len(z), fx=None, hx=model.measure)
        kf.sigmas_f = kf.points_fn.sigma_points(x, P)
        kf.update(z, R=R)
        return kf.x, kf.P

    def _filter(self, x, P, measured, fx, hx):
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

        points = MerweScaledSigmaPoints(len(x), alpha=0.5, beta=2.0, kappa=3.0 - len(x))
        kf = UnscentedKalmanFilter(len(x), measured, dt=1.0, hx=hx, fx=fx, points=points)
        kf.x, kf.P = x, P
        return kf


class FadingMemory(ExtendedKalman):
    """A tracker of our own, for all targets at once: a Kalman filter that trusts old measurements less.

    Args:
        forgetting: factor on every predicted covariance, above 1.
    """

    def __init__(self, forgetting=1.05):
        self.forgetting = forgetting

    def predict(self, estimate, motion):
        """The estimate one step later."""
        after = super().predict(estimate, motion)
        return after._replace(covariance=self.forgetting * after.covariance)


class NoiseLevel(NamedTuple):
    """The memory of ``AdaptiveNoise``."""

    level: np.ndarray  # (env, target) running mean of the normalised innovation squared over its expectation


class AdaptiveNoise(ExtendedKalman):
    """A tracker of our own with a memory: it increases the process noise if innovations are larger than expected.

    The level of the process noise is adjusted continuously (Bar-Shalom, Li and Kirubarajan 2001, section 11.2.2).

    Args:
        share: of the newest innovation in the running mean, 0 to 1.
    """

    def __init__(self, share=0.2):
        self.share = share

    def begin(self, estimate, motion):
        """The first estimate: the model's process noise."""
        level = np.ones(estimate.mean.shape[:2])
        return estimate._replace(memory=NoiseLevel(level), process_noise=level[..., None, None] * motion.Q)

    def predict(self, estimate, motion):
        """The estimate one step later."""
        mean, covariance = predict(estimate.mean, estimate.covariance, motion.F, estimate.process_noise)
        return estimate._replace(mean=mean, covariance=covariance)

    def update(self, estimate, scan):
        """The estimate with all returns, at most one for each target."""
        rows, level = np.arange(len(scan.z)), estimate.memory.level.copy()
        for i in range(scan.z.shape[1]):
            at = rows, scan.target[:, i]
            x, P = estimate.mean[at], estimate.covariance[at]
            H = scan.model.jacobian(x)
            S = H @ P @ np.swapaxes(H, -1, -2) + scan.R[:, i]
            ratio = nees(scan.z[:, i] - scan.model.measure(x), S) / S.shape[-1]
            level[at] += np.where(scan.present[:, i], self.share * (ratio - level[at]), 0.0)
        noise = estimate.process_noise * (level / estimate.memory.level)[..., None, None]
        return super().update(estimate, scan)._replace(memory=NoiseLevel(level), process_noise=noise)


def filterpy_ekf():
    """A tracker of filterpy's extended Kalman filters."""
    return OneByOne(FilterpyEkf())


def filterpy_ukf():
    """A tracker of filterpy's unscented Kalman filters."""
    return OneByOne(FilterpyUkf())


def stonesoup_kalman():
    """A tracker of Stone Soup's predictor and updater; its other Kalman filters work in the same way."""
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.updater.kalman import ExtendedKalmanUpdater

    from wavegym.integrations.stonesoup import StoneSoupTracker

    return StoneSoupTracker(KalmanPredictor, ExtendedKalmanUpdater)
