"""O'Rourke and Swindlehurst's RF/EO platforms. The paper leaves PRF, bandwidth and more open: see docs/errata.md."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from itertools import product
from typing import Literal

import numpy as np

from wavegym.core import trees
from wavegym.core.action_sets import JointLibrary, ParameterBox, PerSensorLibrary
from wavegym.core.arrays import Array, for_kernel
from wavegym.core.covariances import trace_cost
from wavegym.core.parameters import changed_default, system_parameters
from wavegym.core.policy import makers_by_form
from wavegym.core.system import ObservationField, State
from wavegym.core.traits import DecisionMaker, DecisionMakers, TimedPulses
from wavegym.sensors import platform_jacobian, platform_measurement
from wavegym.sensors.platform import SHARPNESS
from wavegym.systems.recorded_targets import (
    drawn_windows,
)
from wavegym.systems.rf_eo import kernels
from wavegym.systems.rf_eo import look_kernels as prediction
from wavegym.systems.rf_eo.look_kernels import Scene
from wavegym.systems.rf_eo.scenario import (
    Bounds,
    PlatformScenario,
    Position,
    StateVariance,
    TargetState,
    ranges_of_moving_targets,
)
from wavegym.systems.rf_eo.state import (
    SOON,
    Belief,
    Measurements,
    Truth,
    World,
    direction_fields,
    own_fields,
    platform_fields,
    presence_fields,
)
from wavegym.trackers.protocol import Estimate, MeasurementModel, Scan, Tracker, begin_track, check_kept, of_targets
from wavegym.waveforms import SPEED_OF_LIGHT

NN = (0, 0, 0, 0)  # the state [x xdot y ydot], as kernels take its size
# Sets of range, range-rate and azimuth that a platform may receive together, (7, 3) bool. All three come first.
TOGETHER = np.array(list(product((True, False), repeat=3))[:-1])


@system_parameters
class RfEo(PlatformScenario, DecisionMakers, TimedPulses):
    """Platforms with a radar and a camera choose pulse repetition frequency, bandwidth and zoom.

    Description
        Each target's state is [x xdot y ydot] (m, m/s). It moves as x_{k+1} = A x_k + w_k with white-noise acceleration
        of density q (eq. 2). Platform j measures range, range-rate and azimuth of every target (eqs. 4 to 6) with the
        variances (c / 2B)^2 / 12, (lambda PRF / (2 Nfft))^2 / 12 and alpha^2 / 12. It receives only quantities inside
        its field of view: r <= c / (2 PRF), |rdot| <= lambda PRF / 4, |azimuth| <= Npix alpha / 2. A high PRF covers
        fast targets, a low PRF covers distant targets, and a wide image has coarse pixels. As in the paper, quantities
        beyond the unambiguous interval of range or range-rate are not received. With ``folding`` they are received
        folded, as in a real radar.

        An extended Kalman filter in information form (eqs. 8 to 11) updates each target with the quantities received.
        If the prior is too wide for a single linearisation, the filter iterates. If the posterior is too wide as well,
        as after a range alone, the filter adds the linearisation error to the noise (posterior linearisation).
        Schedulers predict the covariance with a variance that grows at the edge of the field of view (eqs. 12 and 13).

        A ``tracker`` of your own receives one scan of each platform for each set of quantities that were received
        together: for example, range, range-rate and azimuth of some targets, and only the azimuth of others. Azimuths
        count from the platform's first look direction and are within pi of the estimated azimuth. Folded quantities are
        unfolded first, and are left out if their fold is not certain.

        With a ``slew_rate`` an action also turns each platform's look direction, by at most slew_rate dt, before the
        platform measures. Otherwise the look direction is fixed.

        With ``births`` and ``lifetime`` targets come and go. A target is first measured, and first counts in the cost,
        one step after its birth. The tracker and the schedulers know both times and the first estimate in advance.

        With ``folding``, range is received modulo c / (2 PRF) and range-rate modulo lambda PRF / 2. The radar receives
        neither if the echo overlaps even partly with a transmitted pulse (``duty``), or if the folded range-rate lies
        in the clutter notch (``notch``). Error variances do not depend on the SNR here, so a partly eclipsed echo
        counts as lost. The filter uses a range or a range-rate only if every other fold is exp(5^2 / 2) times less
        likely than the nearest one, because one Gaussian for each target cannot represent several folds. Schedulers
        predict the expected covariance, weighted with the probabilities that the target is seen and that its fold is
        certain.

    Rewards
        -trace(W P) summed over the targets in the scene, in m^2. W is diag(weights) or a full matrix. The weights of
        velocities are in s^2.

    Starting state
        True targets start at ``starts``. With ``first_estimate="halfway"`` the estimates lie at half the true
        coordinates and have zero velocity (the paper's "about midway"). With ``"drawn"`` they are drawn around the
        truth with covariance P0 = diag(prior_variance).

    Episode end
        Truncated after ``horizon`` steps: tracking would continue, and no resource runs out.

    References
        S. M. O'Rourke and A. L. Swindlehurst, "Adaptive RF/EO sensing with field-of-view constraints".
    """

    terminates = False
    chooses_prf = True

    nees_dimension = 4  # position and velocity

    @property
    def lost_beyond(self) -> float:
        """Half the range interval of the highest PRF, m: a prediction farther off takes a range for that of another."""
        return 0.25 * SPEED_OF_LIGHT / self.prf[1]

    @property
    def actions(self) -> PerSensorLibrary | JointLibrary | ParameterBox:
        """The action set: an index for each platform, a joint index, or a box."""
        return self.action_set.actions

    @property
    def decision_makers(self) -> tuple[DecisionMaker, ...]:
        """The platforms; each observes the predicted measurements of all targets at its own place."""
        makers, targets = makers_by_form(self.actions, "platform"), len(self.starts)
        turning = self.slew_rate > 0.0
        return tuple(maker._replace(fields=own_fields(targets, j, turning)) for j, maker in enumerate(makers, 1))

    def candidates(self) -> Array:
        """See ``PlatformActions.candidates``."""
        return self.action_set.candidates

    def aimed_settings(self, belief: Belief, actions: Array) -> Array:
        """PRF, bandwidth, pixel angle and look direction after the turn, (env[, candidate], platform, 4)."""
        settings = self.action_set.settings(actions)
        looks = belief.looks if settings.ndim == 3 else belief.looks[:, None]
        if self.slew_rate > 0.0:
            turned = looks + settings[..., 3]
            looks = turned - 2.0 * math.pi * np.rint(turned / (2.0 * math.pi))
        aimed = np.empty((len(belief.looks), *settings.shape[1:-1], 4))
        for q in range(3):  # column by column: NumPy takes twice as long for rows of three
            aimed[..., q] = settings[..., q]
        aimed[..., 3] = looks
        return aimed

    @cached_property
    def _scene(self) -> Scene:
        """Kernel arguments: model, platforms whose azimuths count from +y, penalties, and the scalars."""
        fence = np.array([self.sharpness or (SHARPNESS[self.penalty],) * 3, self.height])
        F, Q = (np.repeat(matrix[None], len(self.starts), axis=0) for matrix in (self.motion.F, self.motion.Q))
        return Scene(F, Q[None], self._seats, fence, self._rules, self._stay)

    def _assumed(self, belief: Belief) -> Scene:
        """``_scene``, with the tracker's process noise."""
        if belief.process_noise is None:
            return self._scene
        return self._scene._replace(Q=for_kernel(belief.process_noise))

    def target_ranges(self, world: World) -> Array:
        """Range and range-rate of every target at every platform, (env, target, step, platform, 2)."""
        return ranges_of_moving_targets(self, world, self.platforms)

    def draw_world(self, rng: np.random.Generator) -> World:
        """All draws of one episode."""
        S, P, H = len(self.starts), len(self.platforms), self.horizon
        draws = (rng.standard_normal(shape) for shape in ((S, 4), (H, S, 4), (H, P, S, 3)))
        return World(*draws)

    def initial(self, world: World) -> State:
        """Targets at their starts, and the first estimates."""
        count, S = world.start.shape[:2]
        recorded, window = self.truth_model._recorded, None
        true_states = np.tile(np.array(self.starts), (count, 1, 1))
        if recorded:
            window = drawn_windows(recorded, world.process[:, 0, :, 0])
            true_states = recorded.states(window, np.zeros(count, np.int64))
        if self.first_estimate == "drawn":
            mean = true_states + np.sqrt(self.truth_model.prior_variance) * world.start
        else:
            mean = true_states * np.array([0.5, 0.0, 0.5, 0.0])
        covariance = np.tile(np.diag(self.prior_variance), (count, S, 1, 1))
        nothing = np.zeros((count, S), np.int64)
        truth = Truth(true_states, nothing, nothing.copy(), np.zeros(count), window)
        looks = np.tile(self.places[:, 2], (count, 1))
        first = Estimate(mean, covariance)
        if self._given_tracker:
            first = begin_track(self._given_tracker, first, self.motion)
        return State(truth, _believed(np.zeros(count, np.int64), first, looks))

    @cached_property
    def _true_motion(self) -> tuple[Array, Array]:
        """Kernel arguments: transition matrix (1, 4, 4) and noise factor (4, 4) of the world."""
        motion = self.truth_model.motion
        return motion.F[None].copy(), motion.noise_factor

    def folded(self, value: Array, high: Array) -> tuple[Array, Array]:
        """Quantities (..., 3) as the radar receives them, and whether it sees them (...); high: upper edges."""
        widths = np.stack(np.broadcast_arrays(high[..., 0], 2.0 * high[..., 1]), axis=-1)
        off = value[..., :2] - widths * np.rint(value[..., :2] / widths)
        half = np.stack(
            [self.truth_model.duty * widths[..., 0], np.full(widths.shape[:-1], self.truth_model.notch)], -1
        )
        folded = np.concatenate([off, value[..., 2:]], axis=-1)
        folded[..., 0] += np.where(off[..., 0] < 0.0, widths[..., 0], 0.0)
        return folded, (np.abs(off) >= half).all(axis=-1)

    def move(self, truth: Truth, step: Array, world: World) -> Truth:
        """The targets one step on."""
        recorded = self.truth_model._recorded
        if recorded and truth.window is not None:
            return truth._replace(targets=recorded.states(truth.window, step + 1))
        moved = np.empty(truth.targets.shape)
        kernels.move(step, truth.targets, world.process, *self._true_motion, self._stay, moved, NN)
        return truth._replace(targets=moved)

    def measure(self, truth: Truth, belief: Belief, action: Array, world: World) -> Measurements:
        """The platforms' measurements of every target with the settings ``action``."""
        count, targets = belief.mean.shape[:2]
        z, share = np.empty((count, targets, 3 * len(self.platforms))), np.empty(count)
        variance = np.empty(z.shape)
        kernels.receive(
            belief.step, belief.mean, belief.covariance, truth.targets, world.error,
            self.aimed_settings(belief, action), self.truth_model._rules, self._assumed(belief), z, variance, share, NN
        )  # fmt: skip
        return Measurements(z, variance, share, self.present(belief.step + 1))

    def track(self, belief: Belief, action: Array, measurements: Measurements) -> Belief:
        """One step of the tracker."""
        z, variance, *_ = measurements
        settings = self.aimed_settings(belief, action)
        if self._given_tracker:
            return self._tracked(self._given_tracker, belief, settings, z, variance)
        x, P = np.empty(belief.mean.shape), np.empty(belief.covariance.shape)
        kernels.track(belief.step, belief.mean, belief.covariance, z, variance, settings, self._scene, x, P, NN)
        return Belief(belief.step + 1, x, P, settings[..., 3].copy())

    def _tracked(self, tracker: Tracker, belief: Belief, settings: Array, z: Array, variance: Array) -> Belief:
        """``track`` with the given tracker, platform by platform."""
        before = Estimate(belief.mean, belief.covariance, belief.memory, belief.process_noise)
        now = check_kept(tracker, before, tracker.predict(before, self.motion))
        if self._come_and_go:
            now = of_targets(self.present(belief.step + 1), now, before)
        if self.folding:
            given, z, variance = (for_kernel(z), for_kernel(variance)), np.empty(z.shape), np.empty(z.shape)
            x, P = for_kernel(now.mean), for_kernel(now.covariance)
            kernels.unfold(x, P, *given, settings, self._scene, z, variance, NN)
        for j, place in enumerate(self.places):
            turned = settings[:, None, j, 3] - place[2]
            own = slice(3 * j, 3 * j + 3)
            for scan in self._scans(now, place, z[..., own], variance[..., own], turned):
                now = check_kept(tracker, now, tracker.update(now, scan))
        return _believed(belief.step + 1, now, settings[..., 3].copy())

    def _scans(self, now: Estimate, place: Array, z: Array, variance: Array, turned: Array) -> list[Scan]:
        """The scans of the platform at ``place``, one for each set of quantities that were received together.

        Args:
            now: the estimate before these scans.
            place: (x, y) and the direction from which azimuths count, (3,).
            z, variance: measurements and their variances, infinite for quantities not received, (env, target, 3).
            turned: the direction from which azimuths were measured, minus the direction of ``place``, (env, 1).
        """
        azimuth = platform_measurement(now.mean, place, self.as_printed)[..., 2]
        off = z[..., 2] + turned - azimuth
        z = np.stack([z[..., 0], z[..., 1], azimuth + off - 2.0 * math.pi * np.rint(off / (2.0 * math.pi))], axis=-1)
        target = np.broadcast_to(np.arange(z.shape[1]), z.shape[:2])
        scans = []
        for together in TOGETHER:
            present = (np.isfinite(variance) == together).all(axis=-1)
            if present.any():
                kept = np.flatnonzero(together).tolist()
                R = np.where(present[..., None], variance[..., kept], 1.0)[..., None] * np.eye(len(kept))
                scans.append(Scan(z[..., kept], present, target, R, platform_model(place, kept, self.as_printed)))
        return scans

    def annotate(self, truth: Truth, measurements: Measurements) -> Truth:
        """The truth with the number of quantities received, and the predicted information."""
        received = np.isfinite(measurements.variance).sum(axis=2)
        unseen = np.where((received > 0) | ~measurements.present, 0, truth.unseen + 1)
        return Truth(truth.targets, received, unseen, measurements.information, truth.window)

    def predict(self, belief: Belief, actions: Array, outcome: None = None) -> Belief:
        """The belief one step ahead: predicted means, and covariances of eq. (11) with the penalised variances.

        The tracker's process noise is assumed to stay the same.
        """
        several, settings = self._settings(belief, actions)
        shape = (len(belief.step), settings.shape[1], len(self.starts))
        x, P = np.empty((*shape, 4)), np.empty((*shape, 4, 4))
        scene = self._assumed(belief)
        prediction.predict(belief.step, belief.mean, belief.covariance, settings, scene, x, P, NN)
        step = (belief.step + 1)[:, None].repeat(shape[1], axis=1)
        Q = belief.process_noise
        noise = None if Q is None else Q[:, None].repeat(shape[1], axis=1)
        ahead = Belief(step, x, P, settings[..., 3].copy(), process_noise=noise)
        return ahead if several else trees.tree_map(lambda part: part[:, 0], ahead)

    def information(self, belief: Belief, actions: Array) -> Array:
        """The paper's gain tr(P C' R~^-1 C) of every target one step ahead, (env[, candidate], target).

        The gain of a target outside the scene is set to the threshold, so the target needs no information.
        """
        several, settings = self._settings(belief, actions)
        gain = np.empty((len(belief.step), settings.shape[1], len(self.starts)))
        scene = self._assumed(belief)
        prediction.information(belief.step, belief.mean, belief.covariance, settings, scene, gain, NN)
        if self._come_and_go:
            gain = np.where(self.present(belief.step + 1)[:, None], gain, self.threshold)
        return gain if several else gain[:, 0]

    def _settings(self, belief: Belief, actions: Array) -> tuple[bool, Array]:
        """Whether actions have an axis of candidates, and their settings (env, candidate, platform, 4)."""
        several = actions.ndim == (2 if self.action == "joint" else 3)
        return several, self.aimed_settings(belief, actions if several else actions[:, None])

    def cost(self, belief: Belief) -> Array:
        """trace(W P) summed over the targets in the scene."""
        if not self._come_and_go:
            return trace_cost(belief.covariance, self._weights)
        here = self.present(belief.step)[..., None, None]
        return trace_cost(np.where(here, belief.covariance, 0.0), self._weights)

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: each target's uncertainty, and its predicted measurements at each platform."""
        turned = direction_fields(len(self.starts), len(self.platforms)) if self.slew_rate > 0.0 else ()
        return (*self._log_fields, *turned, *(presence_fields(len(self.starts)) if self._come_and_go else ()))

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        out = np.empty((len(belief.step), len(self._decades)))
        kernels.observe(belief.mean, belief.covariance, belief.looks, self._assumed(belief), out, NN)
        logs: Array = np.log(out, out=out)  # one call for all elements is several times faster
        logs *= self._decades
        parts = [logs]
        if self.slew_rate > 0.0:
            ahead, places = belief.mean @ self.motion.F.T, self.places_at(belief)
            off = platform_measurement(ahead[:, :, None], places[:, None], self.as_printed)[..., 2]
            parts.append(off.reshape(len(off), -1))
        if self._come_and_go:
            parts.append(self._presence(belief.step))
        return np.concatenate(parts, axis=1) if len(parts) > 1 else logs

    def _presence(self, step: Array) -> Array:
        """Values of ``presence_fields``, (env, fields)."""
        here, changes = (
            self.present(step + 1),
            self._stay - step[:, None, None],
        )  # (env, target, 2) steps until it changes
        coming = np.where(changes > 0, changes, SOON).min(axis=2)
        return np.stack([here, np.minimum(coming, SOON)], axis=-1).reshape(len(step), -1).astype(np.float64)

    @cached_property
    def _decades(self) -> Array:
        """Factors from natural logarithms to log10, halved for fields of sigma, whose variance the kernel fills."""
        return np.array([0.5 if "sigma" in e.name else 1.0 for e in self._log_fields]) / np.log(10.0)

    @property
    def _log_fields(self) -> tuple[ObservationField, ...]:
        """The observation fields that ``kernels.observe`` fills, before the logarithm."""
        return platform_fields(len(self.starts), len(self.platforms))

    def state_info(self, state: State) -> dict[str, Array]:
        """Figures of each target and of the last settings.

        For each target: ``position_error`` (m), ``position_variance`` (m^2), ``nees`` (expected: 4) and ``received``
        (number of quantities measured in this step). If targets come and go, also ``present``; the figures of an absent
        target are 0. For the settings: ``information``, the minimum predicted weighted information over the targets in
        the scene, and ``below_threshold``. Before the first choice, or without a target in the scene, they are 0 and
        False.
        """
        truth, belief = state
        values, present = np.empty((3, *truth.unseen.shape)), np.empty(truth.unseen.shape, np.bool_)
        below = np.empty(len(belief.step), np.bool_)
        kernels.figures(
            belief.step, belief.mean, belief.covariance, truth.targets, truth.share, self._stay, self._come_and_go,
            self.threshold, values, present, below, NN
        )  # fmt: skip
        figures = {
            "position_error": values[0],
            "position_variance": values[1],
            "nees": values[2],
            "received": truth.received.copy(),
            "information": truth.share.copy(),
            "below_threshold": below,
        }
        return {**figures, "present": present} if self._come_and_go else figures


def _believed(step: Array, estimate: Estimate, looks: Array) -> Belief:
    """The belief with a tracker's estimate."""
    return Belief(step, estimate.mean, estimate.covariance, looks, *estimate[2:])


def platform_model(place: Array, quantities: Sequence[int], as_printed: bool = False) -> MeasurementModel:
    """Some of range (0), range-rate (1) and azimuth (2) at a platform (x, y, look direction)."""
    return MeasurementModel(
        lambda states: platform_measurement(states, place, as_printed)[..., quantities],
        lambda states: platform_jacobian(states, place, as_printed)[..., quantities, :],
    )


@system_parameters
class RfEoFar(RfEo):
    """The RF/EO loop with fast, distant targets, whose ranges and range-rates fold.

    Description
        As wavegym/RfEo-v0 with platforms at (-10, -10) and (10, -10) km and two targets 30 to 40 km away. One recedes
        at 230 m/s, one closes at 210 m/s, and q = 1 m^2/s^3. r |rdot| exceeds c lambda / 8, so no pulse repetition
        frequency (PRF) measures both range and range-rate without ambiguity: echoes fold (``folding``).

        A low PRF resolves range-rates finely, but its notch hides more of them, and unfolding needs a more certain
        prediction. Every PRF has blind zones of range. The best PRF therefore changes as the targets move through blind
        zones and notches. At the lowest PRF, 2 kHz, the radar sees a third of the range-rates; the notch of +-10 m/s
        hides the others.

        Schedulers require predicted azimuths to be two standard deviations inside the image (``margin``). With
        ``folding=False, prf=(1e3, 1e5)`` echoes beyond the unambiguous interval are not received. A range then needs a
        PRF of at most 4 kHz, a range-rate one of at least 30 kHz.

    Rewards
        As wavegym/RfEo-v0.

    Starting state
        The first estimates are drawn around the true starts with covariance P0 = diag(prior_variance)
        (``first_estimate="drawn"``).

    Episode end
        Truncated after 200 steps (``horizon``), when the closing target passes between the platforms.
    """

    horizon: int = changed_default(RfEo, "horizon", 200)
    q: float = changed_default(RfEo, "q", 1.0)
    platforms: tuple[Position, ...] = changed_default(RfEo, "platforms", ((-10e3, -10e3), (10e3, -10e3)))
    starts: tuple[TargetState, ...] = changed_default(
        RfEo, "starts", ((-5e3, 0.0, 20e3, 230.0), (0.0, 0.0, 30e3, -210.0))
    )
    first_estimate: Literal["halfway", "drawn"] = changed_default(RfEo, "first_estimate", "drawn")
    prior_variance: StateVariance = changed_default(RfEo, "prior_variance", (1e6, 400.0, 1e6, 400.0))
    prf: Bounds = changed_default(RfEo, "prf", (2e3, 100e3))
    folding: bool = changed_default(RfEo, "folding", True)
    margin: float = changed_default(RfEo, "margin", 2.0)
