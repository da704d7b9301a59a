"""Sira et al.'s closed loop. Carrier, library and gate are not published: proposals of ours (docs/errata.md)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array, for_kernel
from wavegym.core.errors import InputError
from wavegym.core.parameters import system_parameters
from wavegym.core.policy import makers_by_form
from wavegym.core.system import ObservationField, State
from wavegym.core.traits import DecisionMaker, DecisionMakers
from wavegym.sensors import range_and_rate, range_and_rate_jacobian
from wavegym.systems.agile_clutter import kernels
from wavegym.systems.agile_clutter import prediction_kernels as prediction
from wavegym.systems.agile_clutter.scenario import ClutterScenario
from wavegym.systems.agile_clutter.state import (
    NN,
    Belief,
    Hypotheses,
    Kept,
    Measurements,
    PredictedTargets,
    Pulse,
    Truth,
    World,
    kernel_hypotheses,
    sensor_fields,
    target_fields,
)
from wavegym.systems.recorded_targets import (
    drawn_windows,
)
from wavegym.targets import MotionModel, random_path
from wavegym.trackers import Particles, single_gaussian
from wavegym.trackers.jpda import reduction_table
from wavegym.trackers.protocol import (
    UNKNOWN,
    Estimate,
    MeasurementModel,
    Scan,
    Tracker,
    begin_track,
    check_kept,
    of_targets,
)

NO_MIXTURE = np.empty((1, 1, 0))  # in place of the weights of its components


@dataclass(frozen=True)
class GivenTracker:
    """Passes each sensor's scan and the present targets to a user's tracker.

    Args:
        tracker: of the user.
        motion: the motion model that the tracker assumes.
        targets: step of birth of each target, (target,) int, and the steps for which each is tracked.
        radar: the sensors, their laws and the clutter as the kernels take them.
    """

    tracker: Tracker
    motion: MotionModel
    targets: tuple[Array, int]
    radar: kernels.Radar

    def follow(self, belief: Any, pulse: Pulse, measurements: Any) -> Any:
        """The belief one step later: one update for each sensor; targets that it cannot detect keep their estimate."""
        step, (births, lifetime) = belief.step, self.targets
        is_here = (births < step[:, None] + 1) & (step[:, None] + 1 <= births + lifetime)
        before = Estimate(belief.mean, belief.covariance, *(belief.hypotheses or ()))
        now = check_kept(self.tracker, before, self.tracker.predict(before, self.motion))
        now = of_targets(is_here, now, before)
        for i in range(len(self.radar.sensors)):
            is_lit, scan = self._scan(i, now, step, pulse, measurements)
            now = of_targets(is_lit, check_kept(self.tracker, now, self.tracker.update(now, scan)), now)
        mean = np.where((births == step[:, None] + 1)[..., None], measurements.first, now.mean)
        return belief._replace(step=step + 1, mean=mean, covariance=now.covariance, hypotheses=_kept(now))

    def _scan(self, i: int, now: Estimate, step: Array, pulse: Pulse, measurements: Any) -> tuple[Array, Scan]:
        """Which targets sensor i may detect, (env, target) bool, and its scan, for a tracker that believes ``now``."""
        lit, pd = np.empty(now.mean.shape[:2], np.bool_), np.empty(now.mean.shape[:2])
        noise = np.empty((*pd.shape, 2, 2))
        kernels.assume(i, step, now.mean, now.covariance, pulse, self.targets, self.radar, lit, noise, pd, NN)
        z, present = measurements.z[:, i], measurements.present[:, i]
        R = np.empty((*z.shape, 2))
        kernels.noise_of_returns(i, for_kernel(z), pulse, self.radar, R)
        place, density = self.radar.sensors[i], np.empty(len(step))
        kernels.densities(i, pulse, self.radar, density)
        model = MeasurementModel(lambda x: range_and_rate(x, place), lambda x: range_and_rate_jacobian(x, place))
        origin = np.full(present.shape, UNKNOWN)
        return lit, Scan(z, present, origin, R, model, pd, noise, density)


def _kept(estimate: Estimate) -> Kept | None:
    """What the tracker keeps, if anything."""
    _, _, memory, noise = estimate
    return None if memory is None and noise is None else Kept(memory, noise)


@system_parameters
class AgileClutter(ClutterScenario, DecisionMakers):
    """Two radars choose generalised FM chirps while they track targets that come and go, in clutter.

    Description
        Each target's state is [x y xdot ydot] (m, m/s). It moves as x_k = F x_{k-1} + w_k with white acceleration of
        density q (eqs. 1 and 2). Sensor i measures range and range-rate of every target. C is the inverse Fisher
        information of its chirp at unit SNR (section 3.2). Long, wide chirps measure best; phase functions differ in
        the correlation of range and range-rate errors.

        The echo's mean SNR is eta = 2E/N0 = (r0 / r)^4. Its realised SNR fluctuates from step to step
        (``fluctuation``). The target is detected if the receiver's output, with noise, exceeds T = -ln Pf; the receiver
        takes the greatest value over delay and Doppler about the echo. The errors have covariance C / max(realised eta,
        1). The tracker and the schedulers know only the mean: they assume Pd and the mean covariance of detected
        echoes, at the predicted range. Weak echoes have rare, large errors, and the tracker often takes such a return
        for a false one. With ``snr_law="printed"``, Pd = Pf^(1 / (1 + eta)), the errors are those of the mean eta, and
        noise has no false returns, as in the paper.

        False returns are a Poisson field over range and range-rate, new at every step and sensor. Other clutter has
        ``clutter_density`` with all pulses. Noise has (2 T - 1) exp(-T) / (2 pi sqrt(det C)) peaks per m and m/s: a
        finer pulse has more resolution cells. The tracker uses the returns inside its validation gates. A pulse with
        large errors has large gates, so it also admits more clutter.

        This clutter does not depend on what is sent. ``scatterers`` adds ground, sea or rain, of which each pulse
        receives what its ambiguity function lets through; single chirps have nothing to choose there, and trains their
        blind speeds (docs/clutter.md).

        A lower threshold detects weaker echoes and more noise. With ``false_alarms`` a sensor chooses its threshold
        with its waveform (Hong et al.). With ``alarm_density`` every waveform has the threshold that gives this density
        of false returns of noise.

        A receiver is off while its own radar transmits (``eclipsing``). Of an echo that arrives earlier it receives
        only the last part, through a gate fixed in time, with less SNR and information. An echo with less than 2 % of
        its energy left is not detected; where this is predicted, no gate opens. In the default scenario no echo is
        eclipsed.

        Unscented filters with exact joint association update all targets, one sensor after another. The belief about a
        target is a Gaussian mixture. Each component branches by its associations, and the branches are merged down to
        ``components`` without changing the covariance. ``tracker="jpda"`` (joint probabilistic data association) merges
        all branches into one Gaussian at once and is overconfident. ``tracker="particle"`` is a Rao-Blackwellised
        particle filter, which samples joint associations from their exact posterior.

    Rewards
        -trace(Lambda P) summed over the targets present, Lambda = diag(weights): m^2, with 1 s^2 on the velocities. P
        is the covariance of the mixture, including the spread of its components, so a doubtful track costs more. Every
        target exists from its birth to the end of its lifetime, so the cost needs no probability of existence. With
        ``tracker="jpda"`` P stays small for many lost tracks (``lost``, ``nees``). ``reward="error"`` uses the true
        error.

    Starting state
        True targets start at ``starts``. The first estimate is drawn around the start with covariance P0 =
        diag(prior_variance). The tracker receives target s at step ``births[s]`` and first measures it one step later.

    Episode end
        Terminates after ``horizon`` steps, when the last target is gone. The remaining time is observed.

    References
        S. P. Sira, A. Papandreou-Suppappola, D. Morrell and D. Cochran, "Waveform-agile sensing for tracking multiple
        targets in clutter".

        S.-M. Hong, R. J. Evans and H.-S. Shin, "Optimization of waveform and detection threshold for range and
        range-rate tracking in clutter", IEEE Trans. Aerosp. Electron. Syst. 41(1), 2005.
    """

    # Whether returns outside their gates and clutter points count at every sensor, as in the paper, or only at the
    # first that illuminates the target. Only a compiled loop knows the later gates.
    counts_every_sensor: ClassVar[bool] = False

    nees_dimension = 4  # position and velocity
    lost_beyond = 500.0  # m: half the distance of the first targets; farther away another target's returns are nearer

    @property
    def decision_makers(self) -> tuple[DecisionMaker, ...]:
        """Every sensor; its observation fields are those of the targets at this sensor."""
        makers, targets = makers_by_form(self.actions), len(self.starts)
        return tuple(maker._replace(fields=sensor_fields(targets, i)) for i, maker in enumerate(makers, 1))

    def target_ranges(self, world: World) -> Array:
        """Of every target at every sensor, (env, target, lifetime + 1, sensor, 2)."""
        path = self.initial(world).truth.path
        return range_and_rate(path[..., None, :], np.array(self.sensors))

    def candidates(self) -> Array:
        """Every combination of the sensors' waveforms."""
        return self.action_set.candidates

    def draw_world(self, rng: np.random.Generator) -> World:
        """All draws of one episode."""
        S, H, sensors = len(self.starts), self.horizon, len(self.sensors)
        return World(
            rng.standard_normal((S, 4)),
            rng.standard_normal((S, self.lifetime, 4)),
            rng.standard_normal((H, sensors, S, 2)),
            np.asarray(rng.integers(2**64, dtype=np.uint64)),
        )

    def initial(self, world: World) -> State:
        """The true paths, and the first estimates drawn around their starts."""
        count, S = world.start.shape[:2]
        model = self.truth_model
        path = model._true_paths(world)
        first = path[:, :, 0] + np.sqrt(model.prior_variance) * world.start
        mean = np.where(self._targets[0][:, None] == 0, first, self.starts)
        covariance = np.tile(np.diag(self.prior_variance), (count, S, 1, 1))
        truth = Truth(path[:, :, 0].copy(), path, first, np.zeros((count, S), np.int64), np.zeros((count, 4)))
        return State(truth, Belief(np.zeros(count, np.int64), mean, covariance, self._hypotheses(mean, covariance)))

    def _hypotheses(self, mean: Array, covariance: Array) -> Hypotheses:
        """The tracker's hypotheses at the first step: all are equal. Or what a tracker with a memory keeps."""
        if self._given_tracker:
            return _kept(begin_track(self._given_tracker, Estimate(mean, covariance), self.motion))
        if self.tracker == "mixture":
            return single_gaussian(mean, covariance, self.components)
        if self.tracker == "particle":
            return Particles(*(np.repeat(a[:, None], self.particles, axis=1) for a in (mean, covariance)))
        return None

    def _true_paths(self, world: World) -> Array:
        """True states of each target from its birth on, (env, target, lifetime + 1, 4)."""
        if self._recorded:
            return self._recorded.paths(drawn_windows(self._recorded, world.process[:, :, 0, 0]))
        return random_path(self.motion, self.first_states(world), world.process)

    def first_states(self, world: World) -> Array:
        """The true states at birth, (target, 4) or (env, target, 4)."""
        return np.array(self.starts)

    def _check_clutter_of_step(self, step: Array, scan: Array) -> None:
        """InputError where ``scan`` (env, ...) has a NaN: a gate with too much clutter."""
        unknown = np.isnan(scan)
        if unknown.any():
            bad = unknown.any(axis=1)
            where = f"environment {np.argmax(bad)} at step {step[bad][0]}"
            wanted = f"at most {kernels.MOST_CLUTTER:g} (smaller clutter_density, dt or q)"
            raise InputError(f"clutter in a gate of {where} has no bound or one too large, expected {wanted}")

    def move(self, truth: Any, step: Array, world: Any) -> Any:
        """The targets one step along their paths."""
        targets = np.empty(truth.targets.shape)
        kernels.move(step, truth.path, self._targets, targets)
        return truth._replace(targets=targets)

    def measure(self, truth: Any, belief: Any, action: Array, world: Any) -> Any:
        """All returns near the targets: those of targets and clutter in windows, WINDOW times as large as the gates.

        The gates are those that the tracker predicts before any sensor of the step has measured.
        """
        return self._receive(truth, belief, self.pulse(belief, action[:, None]), world)

    def _receive(self, truth: Any, belief: Any, pulse: Pulse, world: Any) -> Measurements:
        """``measure`` with any pulse."""
        step, targets = belief.step, len(self.starts)
        count = np.zeros((len(step), len(self.sensors)), np.int64)
        outside, scan = np.zeros((len(step), targets), np.int64), np.zeros((len(step), 2))
        mixtures = kernel_hypotheses(belief.hypotheses)[1]
        found = kernels.measure(
            *belief[:3], mixtures, trees.tree_map(np.empty_like, mixtures), truth.targets, world.error, world.key,
            pulse.rows((len(step), 1)), self._targets, self.truth_model._radar, *self._model, self._radar,
            count, outside, scan, NN
        )  # fmt: skip
        self._check_clutter_of_step(step, scan)
        present = np.arange(count.max()) < count[..., None]
        z = np.zeros((*present.shape, 2))
        z[present] = found
        first = np.where((step[:, None] + 1 == self._targets[0])[..., None], truth.first, 0.0)
        return Measurements(z, present, first, outside, scan)

    def track(self, belief: Any, action: Array, measurements: Any) -> Any:
        """One step of the tracker.

        Raises:
            NotImplementedError: ``tracker="particle"``, whose draws depend on the order of the returns.
        """
        return self._follow(belief, self.pulse(belief, action[:, None]), measurements)

    def _follow(self, belief: Any, pulse: Pulse, measurements: Any) -> Any:
        """``track`` with any pulse."""
        if self.tracker == "particle":
            raise NotImplementedError("tracker='particle' works in transition() alone, expected another tracker")
        if self._given_tracker:
            own = GivenTracker(self._given_tracker, self.motion, self._targets, self._radar)
            return own.follow(belief, pulse.rows((len(belief.step), 1)), measurements)
        step, mean, covariance, hypotheses = belief[:4]
        x, P = np.empty(mean.shape), np.empty(covariance.shape)
        fresh = trees.tree_map(np.empty_like, hypotheses)
        kernels.track_returns(
            step, mean, covariance, *kernel_hypotheses(hypotheses)[1:], measurements.z,
            measurements.present.sum(axis=2), measurements.first, pulse.rows((len(step), 1)), self._targets,
            *self._model, self._radar, x, P, fresh, NN
        )  # fmt: skip
        return belief._replace(step=step + 1, mean=x, covariance=P, hypotheses=fresh)

    def annotate(self, truth: Any, measurements: Any) -> Any:
        """The truth with the counts of detections, clutter points and returns outside their gates."""
        scan = np.zeros(truth.scan.shape)
        scan[:, :2] = measurements.scan
        return truth._replace(outside=truth.outside + measurements.outside, scan=scan)

    def predict(self, belief: Belief, actions: Array, outcome: Array | None = None) -> Belief:
        """The belief after one pulse of every sensor: predicted means, covariances of eqs. (13) and (14).

        ``outcome``: uniform draws (env, sensor, target) or (env, candidate, ...); a draw below Pd is a detection, which
        counts q2 / Pd instead of q2; a miss updates nothing. In clutter the tracker cannot tell one from the other.
        """
        several = actions.ndim == (2 if self.action == "joint" else 3)
        pulse = self.pulse(belief, actions if several else actions[:, None])
        shape = (len(belief.step), max(a.shape[1] for a in pulse[:-1]))
        if outcome is not None:
            full = shape + self._full_illumination[1].shape[2:]
            outcome = np.broadcast_to(outcome if several else outcome[:, None], full).reshape(-1, *full[2:])
        many = trees.repeated(belief._replace(hypotheses=None), shape[1]) if several else belief
        after = self._predict_pulse(many, pulse.rows(shape), outcome)
        return trees.tree_map(lambda leaf: leaf.reshape(shape + leaf.shape[1:]), after) if several else after

    def _predict_pulse(self, belief: Any, pulse: Pulse, draws: Array | None) -> Belief:
        """``predict`` with any pulse and draws, all with one flat axis: for systems that add a resource."""
        draws = -self._full_illumination[1][0] if draws is None else for_kernel(draws)  # negative: expected
        step, mean, covariance = map(for_kernel, belief[:3])
        x, P = np.empty(mean.shape), np.empty(covariance.shape)
        prediction.predict(
            step, mean, covariance, pulse, draws, self._targets, *self._model, self._radar, reduction_table(),
            x, P, NN
        )  # fmt: skip
        return Belief(step + 1, x, P, None)

    def pulse(self, belief: Belief, actions: Array) -> Pulse:
        """The pulses of ``actions`` (env or 1, candidate, ...): here every sensor illuminates all targets."""
        pulses = self.action_set
        return Pulse(
            pulses.unit_covariance(actions), *self._full_illumination, pulses.alarms(actions), *pulses.windows(actions)
        )

    @cached_property
    def _full_illumination(self) -> tuple[Array, Array]:
        """``strength`` and ``chance`` of a pulse, 1 at every sensor and target."""
        sensors, targets = len(self.sensors), len(self.starts)
        return np.ones((1, 1, sensors)), np.ones((1, 1, sensors, targets))

    @property
    def outcome_shape(self) -> tuple[int, int]:
        """A draw for every sensor and target: whether it is detected."""
        return len(self.sensors), len(self.starts)

    def predicted_targets(self, belief: Belief) -> PredictedTargets:
        """The belief at the time of the next pulse, before any sensor measures."""
        x, P = np.empty(belief.mean.shape), np.empty(belief.covariance.shape)
        present = np.empty(x.shape[:2], np.bool_)
        prediction.predict_present(*belief[:3], self._targets, *self._model, x, P, present, NN)
        return PredictedTargets(x, P, present)

    def assumed_noise(self, belief: Belief, action: Array, sensor: int) -> tuple[Array, Array]:
        """Which targets have a gate at a sensor's next scan (env, target), bool, and their noise (env, target, 2, 2).

        As predicted before any sensor of the step measures; the noise of targets without a gate is 0.
        """
        predicted = self.predicted_targets(belief)
        lit, pd = np.empty(predicted.present.shape, np.bool_), np.empty(predicted.present.shape)
        noise = np.empty((*pd.shape, 2, 2))
        pulse = self.pulse(belief, action[:, None]).rows((len(belief.step), 1))
        kernels.assume(sensor, belief.step, *predicted[:2], pulse, self._targets, self._radar, lit, noise, pd, NN)
        return lit, noise

    @cached_property
    def observation_fields(self) -> tuple[ObservationField, ...]:
        """The observation: time left, and of every target the prediction at the next pulse, also at each sensor."""
        return target_fields(len(self.starts), len(self.sensors))

    def observe(self, belief: Belief) -> Array:
        """See ``observation_fields``."""
        out = np.empty((len(belief.step), len(self.observation_fields)))
        prediction.observe(*belief[:3], self.horizon, self._targets, *self._model, self._radar, out, NN)
        return out

    def state_info(self, state: State) -> dict[str, Array]:
        """For each target, 0 unless ``present``: ``position_error`` (m), ``position_variance`` (m^2), ``squared_error``
        (m^2, weighted with Lambda), ``nees`` (4 for steady echoes, below for fading ones) and ``returns_outside`` (how
        many returns have fallen outside its gates at the first sensor of a step that illuminates it). For the step:
        ``detections``, and ``clutter`` points inside the gates of targets that no earlier sensor has illuminated. With
        ``tracker="particle"``: ``ess`` and ``ancestors``, effective sample size and distinct ancestors as shares of the
        particles. With ``tracker="mixture"``: the ``components`` in use for each target.
        """
        truth, belief = state
        values, present = np.empty((4, *truth.outside.shape)), np.empty(truth.outside.shape, np.bool_)
        components = np.empty(truth.outside.shape, np.int64)
        weight = belief.hypotheses.weight if self.tracker == "mixture" else NO_MIXTURE
        prediction.track_errors(
            *belief[:3], truth.targets, weight, self._targets, self._weights, values, present, components
        )  # fmt: skip
        figures = {
            "present": present,
            "position_error": values[0],
            "position_variance": values[1],
            "squared_error": values[2],
            "nees": values[3],
            "returns_outside": truth.outside.copy(),
            "detections": truth.scan[:, 0].copy(),
            "clutter": truth.scan[:, 1].copy(),
        }
        if self.tracker == "particle":
            figures["ess"], figures["ancestors"] = (truth.scan[:, i] / self.particles for i in (2, 3))
        if self.tracker == "mixture":
            figures["components"] = components
        return figures
