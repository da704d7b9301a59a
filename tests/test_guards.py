"""Every public function of the parts refuses bad values at once, in one line that names the argument.

``GOOD`` holds valid arguments of each function, and what each argument has to be. The bad values follow from that. A
new public function without a row fails ``test_every_public_name_has_a_row``.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wavegym import sensors, targets, trackers, waveforms
from wavegym.core.errors import InputError
from wavegym.systems import urban

NAN, INF = math.nan, math.inf
SCALARS = {  # kind: values that no element may have
    "finite": (NAN, INF, -INF),
    "not nan": (NAN,),
    "log": (NAN, INF),
    "key": (NAN, -1, 1.5, 2**64),
    "positive": (NAN, INF, -INF, 0.0, -1.0),
    "width": (NAN, -INF, 0.0, -1.0),
    "non-negative": (NAN, INF, -INF, -1.0),
    "variance": (NAN, -INF, 0.0, -1.0),
    "probability": (NAN, INF, -0.1, 1.1),
    "open probability": (NAN, INF, 0.0, 1.0, -0.1, 1.1),
    "distribution": (NAN, INF, -0.1, 1.1, 0.77),
    "count": (NAN, 0, -1, 1.5),
    "share": (NAN, INF, 1.0, -0.1),
}
MATRICES = ("covariance", "definite")


class Argument(NamedTuple):
    """A valid argument and what it has to be."""

    kind: str
    value: Any


def finite(value: Any) -> Argument:
    return Argument("finite", value)


def positive(value: Any) -> Argument:
    return Argument("positive", value)


def non_negative(value: Any) -> Argument:
    return Argument("non-negative", value)


def covariance(value: Any) -> Argument:
    return Argument("covariance", value)


def definite(value: Any) -> Argument:
    return Argument("definite", value)


def given_as(value: Any) -> Argument:
    """An argument that is not varied: an object, a choice or a function."""
    return Argument("", value)


EYE, X, H = np.eye(2), np.ones((3, 2)), np.array([[1.0, 0.5]])
P2, P4, P6 = np.array([[2.0, 1.0], [1.0, 3.0]]), 4.0 * np.eye(4), np.diag([9.0, 9.0, 4.0, 4.0, 1.0, 1.0])
PLANAR, TX, RX = np.array([2000.0, -1000.0, -100.0, 800.0]), np.array([3000.0, -16000.0]), np.array([0.0, 500.0])
SIX = np.array([2000.0, -1000.0, -10.0, 8.0, 0.1, 0.1])
Z = np.array([15033.0, 804.9])
CHIRP = waveforms.GaussianChirp(duration=1e-6, chirp_rate=1e12)
TRAIN = waveforms.PulseTrain(CHIRP, count=4, interval=1e-3)
TIMING = waveforms.PulseTiming(duration=1e-5, carrier_hz=1e10, interval=1e-3, count=4)
ECLIPSED = sensors.EclipsedPulse(CHIRP)
LAW = waveforms.chirp_law("pfm")
TRANSITION = Argument("distribution", np.eye(4) * 0.6 + 0.1)  # of four models, as in test_imm.py: compiled once
MU = Argument("distribution", np.array([0.25, 0.25, 0.3, 0.2]))
MODEL = targets.constant_velocity(1.0, 1.0)
TRACK = targets.RecordedTrack("a", np.arange(6.0), np.cumsum(np.full((6, 3), 5.0), axis=0))
CITY = sensors.UrbanMap.load("intersection")
PLACES = {"transmitters": ((2085.0, 1470.5),), "receivers": ((2088.0, 1475.0), (2078.0, 1467.0))}
KALMAN = {"mean": finite(X), "covariance": covariance(P2)}
UPDATE = KALMAN | {"innovation": finite(np.ones(1)), "H": finite(H), "R": covariance(np.array([[5.0]]))}
MOTION = {"F": finite(np.array([[1.0, 1.0], [0.0, 1.0]])), "Q": covariance(EYE)}
MODELS = {"mean": finite(np.ones((4, 6))), "covariance": covariance(np.stack([P6] * 4)), "probability": MU}
WAVEFORM = {"duration": positive(1e-5), "carrier_hz": positive(1e10)}
STEP = {"dt": positive(1.0)}
WHITE = STEP | {"q": non_negative(1.0)}
WIDTH = Argument("width", 3.0)
PRFS = {"widths": positive(np.array([2.0, 3.0])), "variance": positive(np.array([0.1, 0.1]))}
PAIR_FOLD = {
    "measurement": finite(np.ones(2)), "predicted": finite(np.ones(2)), "S": definite(P2),
    "widths": Argument("width", np.array([3.0, 4.0])), "size": positive(4.0),
}  # fmt: skip

GOOD: dict[str, dict[str, Argument]] = {
    # trackers
    "predict": KALMAN | MOTION,
    "predict_covariance": {"covariance": covariance(P2)} | MOTION,
    "update": UPDATE,
    "update_covariance": {name: UPDATE[name] for name in ("covariance", "H", "R")},
    "scalar_updates": KALMAN
    | {"innovation": finite(np.ones(1)), "H": finite(H), "variance": Argument("variance", [5.0])},
    "ekf_predict": KALMAN
    | {"f": given_as(lambda x: x), "jacobian": given_as(lambda x: EYE), "Q": covariance(EYE)},
    "ekf_update": KALMAN
    | {
        "measurement": finite(np.ones(1)),
        "h": given_as(lambda x: x[..., :1]),
        "jacobian": given_as(lambda x: H),
        "R": covariance(np.array([[5.0]])),
    },
    "nees": {"error": finite(X), "covariance": definite(P2)},
    "check_positive_definite": {"name": given_as("P"), "matrix": definite(P2)},
    "gospa": {
        "targets": finite(np.zeros((2, 2))), "tracks": finite(np.ones((3, 2))),
        "cutoff": positive(20.0), "order": positive(2.0),
    },
    "ospa": {
        "targets": finite(np.zeros((2, 2))), "tracks": finite(np.ones((3, 2))),
        "cutoff": positive(20.0), "order": positive(2.0),
    },
    "siap": {"targets": finite(np.zeros((2, 2))), "tracks": finite(np.ones((3, 2))), "cutoff": positive(20.0)},
    "imm_combine": MODELS,
    "imm_mix": MODELS | {"transition": TRANSITION},
    "imm_reweigh": {"predicted": MU, "log_likelihood": Argument("log", np.array([-1.0, -2.0, -1.0, -3.0]))},
    "imm_ukf_scan": {
        "mean": finite(np.stack([SIX] * 4)), "covariance": covariance(np.stack([P6] * 4)), "probability": MU,
        "measurement": finite(Z), "R": definite(P2), "transmitter": finite(TX), "receiver": finite(RX),
        "F": finite(np.stack([np.eye(6)] * 4)), "Q": covariance(np.stack([P6] * 4)), "transition": TRANSITION,
    },
    "ukf_update": {
        "mean": finite(PLANAR), "covariance": definite(P4), "measurement": finite(Z), "R": definite(P2),
        "transmitter": finite(TX), "receiver": finite(RX),
    },
    "variable_structure": {"transition": TRANSITION, "active": given_as([True] * 4)},
    "information_reduction": {"pd": Argument("probability", 0.9), "clutter": non_negative(1.0)},
    "fitted_information_reduction": {"pd": Argument("probability", 0.9), "clutter": non_negative(1.0)},
    "joint_association": {
        "likelihood": non_negative(np.ones((2, 3))), "pd": Argument("open probability", np.array([0.9, 0.8])),
        "clutter_density": positive(1e-4), "gate_probability": Argument("probability", 0.99),
    },
    "jpda_update": {
        "mean": finite(np.zeros((2, 4))), "covariance": covariance(np.stack([P4, P4])),
        "measurements": finite(np.ones((3, 2))), "predicted": finite(np.zeros((2, 2))),
        "S": definite(np.stack([P2, P2])), "cross_covariance": finite(np.ones((2, 4, 2))),
        "pd": Argument("open probability", np.array([0.9, 0.8])), "clutter_density": positive(1e-4),
        "gate": positive(4.0), "gate_probability": Argument("probability", 0.99),
    },
    "lmipda": {
        "likelihood": non_negative(np.ones((2, 2, 3))),
        "models": Argument("distribution", np.full((2, 2), 0.5)),
        "existence": Argument("probability", np.array([0.9, 0.5])),
        "pd": Argument("open probability", np.array([0.9, 0.8])), "clutter_density": positive(1e-4),
    },
    "multilaterate": {
        "measurements": finite(np.array([[15033.0, 8.0], [16000.0, 9.0]])), "R": covariance(np.stack([P2, P2])),
        "transmitter": finite(TX), "receivers": finite(np.stack([RX, PLANAR[:2]])),
    },
    "mixture_update": {
        "mixture": given_as(trackers.single_gaussian(np.tile(PLANAR, (2, 1)), np.tile(P4, (2, 1, 1)), 3)),
        "measurements": finite(np.stack([Z])[None]), "pd": Argument("open probability", np.full((1, 2), 0.9)),
        "noise": definite(np.stack([[P2, P2]])), "sensors": finite(TX[None]), "clutter_density": positive(1e-4),
        "negligible": non_negative(0.1),
    },
    "single_gaussian": {
        "mean": finite(np.tile(PLANAR, (2, 1))), "covariance": definite(np.tile(P4, (2, 1, 1))),
        "components": Argument("count", 3),
    },
    "rbpf_update": {
        "key": Argument("key", 3), "mean": finite(np.tile(PLANAR, (5, 2, 1))),
        "covariance": definite(np.tile(P4, (5, 2, 1, 1))), "measurements": finite(np.stack([Z])[None]),
        "pd": Argument("open probability", np.full((1, 2), 0.9)), "noise": definite(np.stack([[P2, P2]])),
        "sensors": finite(TX[None]), "clutter_density": positive(1e-4),
    },
    "systematic_resample": {"weights": non_negative(np.array([0.5, 1.5])), "u": Argument("share", 0.3)},
    "UrbanTracker": {
        "urban_map": given_as(CITY), "transmitters": finite(PLACES["transmitters"]),
        "receivers": finite(PLACES["receivers"]), "dt": positive(0.25), "turn_rate": finite(0.1),
        "sigma": non_negative(0.25), "sigma_acceleration": non_negative(0.3), "slots": Argument("count", 8),
        "clutter_density": positive(1e-3), "gate_probability": Argument("open probability", 0.99),
        "false_alarm": Argument("open probability", 1e-3), "rate_floor": positive(0.1), "reach": positive(300.0),
        "survival": Argument("probability", 0.99), "birth": Argument("probability", 0.1),
        "confirm": Argument("probability", 0.95), "confirm_after": Argument("count", 4),
        "drop": Argument("probability", (0.03, 0.05)), "merge": non_negative((5.0, 4.0)), "vaguest": positive(5.0),
        "fastest": positive(20.0), "usual_speed": positive(10.0), "cell": positive(1.0),
    },
    # sensors
    "range_law_snr": {
        "range_m": non_negative(np.array([1e4, 2e4])), "reference_range": positive(5e4),
        "nearest_range": positive(100.0),
    },
    "EclipsedPulse": {
        "waveform": given_as(CHIRP), "interval": positive(1e-3), "energy": Argument("probability", 0.99),
        "recovery": non_negative(1e-6),
    },
    "fold_range": {"range_m": non_negative(np.ones(3)), "unambiguous_range": WIDTH},
    "fold_velocity": {"range_rate": finite(np.ones(3)), "unambiguous_velocity": WIDTH},
    "unfold": {"apparent": finite(np.ones(3)), "fold": finite(1.0), "width": WIDTH},
    "fold_update": {
        "measurement": finite(np.ones(3)), "predicted": finite(9.0), "variance": positive(2.0), "width": WIDTH,
        "size": positive(4.0),
    },
    "fold_pair_update": PAIR_FOLD,
    "fold_hypotheses": PAIR_FOLD,
    "agreeing_combinations": {"apparent": finite(((1.0, 2.0), (1.0, 3.0))), "low": finite(0.0), "high": finite(9.0)}
    | PRFS,
    "resolve_folds": {"apparent": finite(np.array([1.0, 2.0])), "low": finite(0.0), "high": finite(9.0)} | PRFS,
    "combined_interval": {"widths": positive(np.array([2.0, 3.0])), "tolerance": non_negative(0.1),
                          "farthest": positive(9.0)},
    "outside_notch": {"range_rate": finite(np.ones(3)), "unambiguous_velocity": WIDTH, "notch": non_negative(0.5)},
    "outside_notch_probability": {
        "predicted": finite(np.ones(3)), "variance": non_negative(0.2), "unambiguous_velocity": WIDTH,
        "notch": non_negative(0.5),
    },
    "range_and_rate": {"state": finite(PLANAR), "sensor": finite(TX)},
    "range_and_rate_jacobian": {"state": finite(PLANAR), "sensor": finite(TX)},
    "multistatic_range_and_rate": {"state": finite(PLANAR), "transmitter": finite(TX), "receiver": finite(RX)},
    "platform_measurement": {"state": finite(PLANAR), "platform": finite(np.ones(3))},
    "platform_jacobian": {"state": finite(PLANAR), "platform": finite(np.ones(3))},
    "platform_view": {
        "prf": positive(1e3), "bandwidth": positive(1e6), "pixel_angle": positive(1e-3), "wavelength": positive(0.03),
        "fft_length": Argument("count", 128), "pixels": Argument("count", 1000),
    },
    "detection_probability": {
        "snr": positive(np.ones(3)), "false_alarm": Argument("open probability", 0.01),
        "fluctuation": given_as("swerling3"), "pulses": Argument("count", 2),
    },
    "detected_snr": {
        "uniform": Argument("share", np.full(3, 0.5)), "snr": positive(np.ones(3)),
        "false_alarm": Argument("open probability", 0.01), "fluctuation": given_as("swerling3"),
        "pulses": Argument("count", 2),
    },
    "assumed_echo": {"snr": positive(np.ones(3)), "law": given_as(sensors.echo_law((0.01,)))},
    "echo_law": {"false_alarms": Argument("open probability", np.full(2, 0.01)), "fluctuation": given_as("swerling3")},
    "contiguous_bands": {"channels": Argument("count", 8), "widest": Argument("count", 3)},
    "noise_factors": {
        "noise": positive(np.ones((2, 8))), "bands": given_as(sensors.contiguous_bands(8)),
        "receiver": given_as("whitening"),
    },
    "unit_snr_range": {
        "energy": positive(np.ones(3)), "gain_db": finite(30.0), "wavelength": positive(0.03),
        "cross_section": positive(1.0), "noise_temperature": positive(290.0), "losses_db": non_negative(3.0),
    },
    "mean_inverse_detected_snr": {
        "snr": positive(np.ones(3)), "false_alarm": Argument("open probability", 0.01), "pulses": Argument("count", 2),
        "least": non_negative(1.0),
    },
    "realised_snr": {
        "uniform": Argument("share", np.full(3, 0.5)), "snr": positive(np.ones(3)), "pulses": Argument("count", 2),
    },
    "energy_detection_probability": {
        "energy_ratio": positive(np.ones(3)), "false_alarm": Argument("open probability", 0.01),
    },
    "motion_loss": {
        "duration": non_negative(0.1), "wavelength": positive(0.03), "density": non_negative(1.0),
        "acceleration": non_negative(1.0),
    },
    "acceleration_loss": {
        "duration": non_negative(0.1), "wavelength": positive(0.03), "acceleration": finite(1.0),
    },
    "mean_rate_variance": {"duration": non_negative(0.1), "density": non_negative(1.0)},
    "false_return_density": {
        "unit_covariance": definite(P2), "threshold": positive(9.0), "elements": Argument("count", 3),
    },
    "false_return_threshold": {
        "unit_covariance": definite(P2), "density": positive(1e-6), "elements": Argument("count", 3),
    },
    "gate_probability": {"gate": positive(4.0)},
    "gate_volume": {"S": definite(P2), "gate": positive(4.0)},
    "inside_gate": {"innovation": finite(np.ones(2)), "S": definite(P2), "gate": positive(4.0)},
    "union_clutter": {
        "key": Argument("key", 3), "centre": finite(np.ones((1, 2))), "S": definite(P2[None]), "gate": positive(4.0),
        "density": non_negative(0.01),
    },
    "fov_penalty": {
        "kind": given_as("logistic"), "x": Argument("not nan", np.array([1.0, -1.0])), "low": given_as(-2.0),
        "high": given_as(2.0), "sharpness": positive(100.0), "height": non_negative(10.0),
    },
    "Scatterers": {
        "density": non_negative(0.5), "reference_range": positive(20e3), "exponent": non_negative(3.0),
        "nearest": positive(100.0), "rate": finite(2.0), "spread": non_negative(0.5),
    },
    "clutter_power": {
        "scatterers": given_as(sensors.Scatterers(density=0.5, reference_range=20e3)), "waveform": given_as(CHIRP),
        "carrier_hz": positive(10e9), "ranges": finite(2e4), "rates": finite(3.0),
    },
    "exceedance": {
        "threshold": non_negative(np.ones(3)), "clutter": non_negative(np.ones(3)), "snr": non_negative(np.ones(3)),
    },
    "Antenna": {
        "urban_map": given_as(CITY), "position": finite((2085.0, 1470.5)), "axis": finite((0.6, 0.8)),
    },
    "ArrayReceiver": {
        "train": given_as(TRAIN), "carrier": positive(4e9), "sample_rate": positive(4e7), "reach": positive(300.0),
        "elements": Argument("count", 3),
    },
    "Building": {"corners": finite(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))), "reflectivity": Argument("probability", 0.4)},
    "Road": {"centre": finite(((0.0, 0.0), (1.0, 0.0))), "width": positive(5.0)},
    "UrbanMap": {"discretes": finite(((0.0, 0.0), (1.0, 0.0)))},
    # targets
    "constant_velocity": WHITE,
    "constant_acceleration": WHITE,
    "constant_turn": WHITE | {"turn_rate": finite(0.1)},
    "nearly_constant_velocity": STEP | {"sigma": non_negative(0.5), "acceleration": non_negative(0.5)},
    "nearly_constant_acceleration": STEP | {"sigma": non_negative(0.5), "push": non_negative(0.2)},
    "coordinated_turn": STEP
    | {"turn_rate": finite(0.1), "sigma": non_negative(0.5), "acceleration": non_negative(0.5)},
    "MotionModel": MOTION | {"names": given_as(("r", "rdot"))},
    "random_path": {"model": given_as(MODEL), "start": finite(np.zeros(2)), "noise": finite(np.ones((4, 2)))},
    "Segment": {"duration": positive(5.0), "acceleration": finite(1.0), "turn_rate": finite(0.1)},
    "ScriptedPath": {"start": finite((0.0, 0.0)), "velocity": finite((1.0, 0.0))},
    "RecordedTrack": {"id": given_as("a"), "times": finite(TRACK.times), "positions": finite(TRACK.positions)},
    "windows": {
        "tracks": given_as(TRACK), "dt": positive(0.5), "steps": Argument("count", 3), "max_gap": positive(30.0),
        "smoothing": non_negative(0.0),
    },
    "summarise": {"track": given_as(TRACK), "max_gap": positive(30.0), "smoothing": non_negative(1.0)},
    "range_paths": {"catalogue": given_as(targets.windows(TRACK, 0.5, 3)), "radar": finite(np.full(3, -9.0))},
    # waveforms
    "GaussianChirp": {"duration": positive(1e-6), "chirp_rate": non_negative(1e12)},
    "TrapezoidChirp": {
        "kind": given_as("pfm"), "duration": positive(1e-6), "sweep": non_negative(1e6), "shape": positive(3.0),
        "rise": positive(1e-7),
    },
    "PulseTrain": {"pulse": given_as(CHIRP), "count": Argument("count", 4), "interval": positive(1e-3)},
    "FisherFactors": {"residual": positive(1.0), "slope": finite(0.5), "spread": positive(np.ones(2))},
    "gaussian_fisher_factors": {"duration": positive(1e-6), "signed_chirp_rate": finite(np.array([1e10, -1e10]))},
    "gaussian_measurement_covariance": WAVEFORM | {"signed_chirp_rate": finite(1e10)},
    "trapezoid_fisher_factors": {
        "moments": finite(LAW.moments), "duration": positive(1e-6), "signed_sweep": finite(1e6),
    },
    "chirp_measurement_covariance": WAVEFORM | {"moments": finite(LAW.moments), "signed_sweep": finite(1e6)},
    "chirp_law": {"kind": given_as("hfm"), "shape": positive(0.5), "rise_fraction": Argument("share", 0.1)},
    "chirp_rate_for_sweep": {"sweep_hz": finite(1e6), "duration": positive(1e-6)},
    "sweep_for_chirp_rate": {"chirp_rate": finite(1e12), "duration": positive(1e-6)},
    "gaussian_chirp_library": {"durations": positive((1e-6, 2e-6)), "sweeps": finite((1e6, 0.0))},
    "trapezoid_chirp_library": {
        "kinds": given_as(("lfm",)), "durations": positive((1e-6, 2e-6)), "sweeps": non_negative((1e6, 2e6)),
    },
    "measurement_covariances": {
        "library": given_as(waveforms.gaussian_chirp_library((1e-6,), (0.0,))), "carrier_hz": positive(1e10),
    },
    "transmitted_interval": {"waveform": given_as(CHIRP), "energy": Argument("probability", 0.99)},
    "PulseTiming": {
        "duration": positive(1e-5), "carrier_hz": positive(1e10), "interval": positive(1e-3),
        "count": Argument("count", 4), "recovery": non_negative(1e-6), "max_duty": Argument("probability", 0.1),
    },
    "pulse_timings": {"waveforms": given_as((CHIRP,)), "carrier_hz": positive(1e10)},
    "time_left": {"dwells": non_negative(np.ones(2)), "step": positive(3.0), "switching": non_negative(0.1)},
    "check_time_on_target": {
        "timings": given_as({"a": TIMING}), "step": positive(3.0),
        "farthest": non_negative(10.0),
    },
    "check_range_folds": {"timings": given_as({"a": TIMING}), "farthest": non_negative(10.0)},
    "check_velocity_folds": {"timings": given_as({"a": TIMING}), "fastest": non_negative(1.0)},
    "check_dwells": {"dwells": non_negative(np.ones(2)), "step": positive(3.0), "switching": non_negative(0.1)},
    "ambiguity": {"waveform": given_as(CHIRP), "delays": finite(np.zeros(2)), "dopplers": finite(np.zeros(2))},
    "zero_delay_cut": {"waveform": given_as(CHIRP), "dopplers": finite(np.zeros(2))},
    "zero_doppler_cut": {"waveform": given_as(CHIRP), "delays": finite(np.zeros(2))},
}  # fmt: skip
ALIASES = {  # how messages call an argument
    "covariance": "P", "matrix": "P", "measurement": "innovation", "sigma_acceleration": "sigma",
}  # fmt: skip
ROOMS = (trackers, sensors, targets, waveforms, urban)
NO_NUMBERS = {
    # results, which functions of this package make
    "Association", "GaussianMixture", "Gospa", "LmipdaUpdate", "MixtureUpdate", "Particles", "RbpfUpdate", "Tracks",
    "Siap", "Agreements", "Folded", "FoldHypotheses", "FoldUpdate", "PairUpdate", "Bands",
    "Echoes", "Peaks", "View", "Kinematics", "Piece", "TrackSummary", "Windows", "ChirpLaw",
    # made of objects that are checked themselves, of text or of files, which have tests of their own
    "EclipsedLibrary", "EclipsePulses", "EclipseTables", "eclipse_tables",
    "Multistatic", "Waveform", "FrequencyLaw", "parse_law", "read_tracks", "numeric_fisher_information",
    "plot_ambiguity", "SPEED_OF_LIGHT", "FLUCTUATIONS", "Urban",
}  # fmt: skip
CASES = [
    (function, name) for function, arguments in GOOD.items() for name, argument in arguments.items() if argument.kind
]

ANY_LENGTH = {  # arguments that fit after the loss of an element
    *((function, name) for function in ("ambiguity", "zero_delay_cut", "zero_doppler_cut") for name in GOOD[function]),
    ("range_law_snr", "range_m"),
    ("detection_probability", "snr"),
    ("mean_inverse_detected_snr", "snr"),
    ("echo_law", "false_alarms"),
    ("assumed_echo", "snr"),
    ("unit_snr_range", "energy"),
    ("energy_detection_probability", "energy_ratio"),
    ("fov_penalty", "x"),
    ("systematic_resample", "weights"),
    ("FisherFactors", "spread"),
    ("time_left", "dwells"),
    ("fold_range", "range_m"),
    ("fold_velocity", "range_rate"),
    ("unfold", "apparent"),
    ("fold_update", "measurement"),
    ("outside_notch", "range_rate"),
    ("outside_notch_probability", "predicted"),
    ("combined_interval", "widths"),
    ("check_dwells", "dwells"),
    ("gaussian_fisher_factors", "signed_chirp_rate"),
    ("joint_association", "likelihood"),  # fewer measurements
    ("lmipda", "likelihood"),
    ("scalar_updates", "variance"),
}
SHAPED = [case for case in CASES if isinstance(GOOD[case[0]][case[1]].value, np.ndarray) and case not in ANY_LENGTH]


def public(name: str) -> Any:
    """The public object of this name."""
    return next(getattr(room, name) for room in ROOMS if name in room.__all__)


def call(function: str, **changed: Any) -> Any:
    """Call the function with its valid arguments, some changed."""
    arguments = {name: argument.value for name, argument in GOOD[function].items()} | changed
    return public(function)(**arguments)


def spoiled(argument: Argument, data: st.DataObject) -> Any:
    """A value that the argument must not have: a bad element, or a matrix that is no covariance."""
    array = np.array(argument.value, np.float64)
    bad = (NAN, INF, "asymmetric", "indefinite") if argument.kind in MATRICES else SCALARS[argument.kind]
    if argument.kind == "definite":
        bad += ("singular",)
    index = tuple(data.draw(st.integers(0, size - 1)) for size in array.shape)
    value = data.draw(st.sampled_from(bad))
    n = array.shape[-1] if array.ndim else 1
    if value == "asymmetric" and n == 1:
        value = "indefinite"
    if value == "asymmetric":
        array[*index[:-2], 0, 1] += 1.0
    elif value == "indefinite":
        array[index[:-2]] -= 2.0 * np.trace(array[index[:-2]]) * np.eye(n)
    elif value == "singular":
        array[index[:-2]] = 0.0
    elif argument.kind in ("count", "key"):
        return value
    else:
        array[index] = value
    if isinstance(argument.value, tuple):
        return tuple(map(tuple, array.tolist())) if array.ndim > 1 else tuple(array.tolist())
    return array if array.ndim else float(array)


def test_every_public_name_has_a_row() -> None:
    names = {name for room in ROOMS for name in room.__all__}
    assert names == set(GOOD) | NO_NUMBERS


@pytest.mark.parametrize("function", GOOD)
def test_the_good_arguments_are_accepted(function: str) -> None:
    call(function)


@pytest.mark.parametrize(("function", "name"), CASES)
@settings(max_examples=12)
@given(data=st.data())
def test_a_bad_value_is_refused_in_one_line(function: str, name: str, data: st.DataObject) -> None:
    bad = spoiled(GOOD[function][name], data)
    with pytest.raises(InputError) as caught:
        call(function, **{name: bad})
    message = str(caught.value)
    assert "\n" not in message
    assert name.rstrip("s") in message or ALIASES[name] in message
    assert "expected" in message or "should be" in message  # the latter: of pydantic


@pytest.mark.parametrize(("function", "name"), SHAPED)
def test_a_shape_that_does_not_fit_is_refused_in_one_line(function: str, name: str) -> None:
    """One element less on the last axis."""
    array = np.asarray(GOOD[function][name].value, np.float64)
    with pytest.raises(InputError) as caught:
        call(function, **{name: array[..., :-1]})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("refused", "message"),
    [
        (lambda: sensors.range_law_snr(-5), r"range_m is -5\.0, expected a finite number >= 0"),
        (
            lambda: trackers.imm_combine(np.zeros((2, 2)), np.stack([EYE, EYE]), (1, 1)),
            r"the sum of probability is 2\.0, expected 1 \(nearest: divide by the sum\)",
        ),
        (
            lambda: trackers.imm_mix(np.zeros((2, 2)), np.stack([EYE, -EYE]), (0.5, 0.5), EYE),
            r"covariance\[1\] has the eigenvalue -1, expected a positive semidefinite matrix \(nearest eigenvalue: 0\)",
        ),
        (
            lambda: trackers.update(np.zeros(2), EYE, np.zeros(2), EYE, -5 * EYE),
            r"R has the eigenvalue -5, expected a positive semidefinite matrix \(nearest eigenvalue: 0\)",
        ),
    ],
)
def test_mistakes_that_users_made(refused: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        refused()


RECEIVER = sensors.ArrayReceiver(TRAIN, 4e9, 4e7, 300.0)
PAIR = sensors.Multistatic(*(sensors.Antenna(CITY, places[0]) for places in PLACES.values()))
DELAYS, OUTPUTS = np.full((1, *RECEIVER.shape[:2]), 1e-6), np.ones(RECEIVER.shape)
IMAGE = RECEIVER.image(OUTPUTS)


@pytest.mark.parametrize(
    ("method", "arguments", "names"),
    [
        (RECEIVER.receive, (DELAYS, np.ones(1, complex)), ("delay", "amplitudes")),
        (RECEIVER.image, (OUTPUTS,), ("outputs",)),
        (RECEIVER.peaks, (IMAGE, 10.0), ("image", "threshold")),
        (RECEIVER.false_returns, (10.0,), ("threshold",)),
        (RECEIVER.threshold, (1e-4,), ("density",)),
        (PAIR.visible, (PLANAR[:2],), ("points",)),
        (PAIR.measure, (PLANAR,), ("state",)),
        (PAIR.delays, (SIX[None], np.zeros(1), 0.0, 0.0), ("state", "path", "times", "offsets")),
        (PAIR.transmitter.bounces, (PLANAR[:2],), ("points",)),
        (CITY.indoors, (PLANAR[:2],), ("points",)),
        (CITY.on_road, (PLANAR[:2],), ("points",)),
        (TRACK.resample, (1.0, 30.0, 0.0), ("dt", "max_gap", "smoothing")),
        (TRACK.pieces, (30.0,), ("max_gap",)),
        (targets.ScriptedPath((0.0, 0.0), (1.0, 0.0)).sample, (np.ones(3),), ("times",)),
        (CHIRP.measurement_covariance, (1e10, 10.0), ("carrier_hz", "snr")),
        (CHIRP.fisher_factors().measurement_covariance, (1e10,), ("carrier_hz",)),
        (ECLIPSED.visible_share, (1e3,), ("range_m",)),
        (ECLIPSED.snr_factor, (1e3,), ("range_m",)),
        (ECLIPSED.fisher_factors, (1e3,), ("range_m",)),
        (ECLIPSED.measurement_covariance, (1e3, 1e10), ("range_m", "carrier_hz")),
        (TIMING.range_blind_zones, (1e6,), ("farthest",)),
        (TIMING.velocity_blind_zones, (1.0, 100.0), ("notch", "fastest")),
        (TIMING.time_on_target, (1e5,), ("farthest",)),
    ],
    ids=lambda value: getattr(value, "__qualname__", None),
)
@pytest.mark.parametrize("bad", [NAN, INF])
def test_methods_refuse_numbers_that_are_not_finite(method: Any, arguments: Any, names: Any, bad: float) -> None:
    method(*arguments)
    for k, name in enumerate(names):
        spoiled = np.array(arguments[k])
        spoiled[(0,) * spoiled.ndim] = bad
        with pytest.raises(InputError, match=name) as caught:
            method(*arguments[:k], spoiled if spoiled.ndim else spoiled.item(), *arguments[k + 1 :])
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["position", "axis"])
def test_an_antenna_stands_in_a_plane(name: str) -> None:
    with pytest.raises(InputError, match=rf"antenna's {name} has shape \(3,\), expected \(2,\)"):
        call("Antenna", **{name: (0.6, 0.8, 0.0)})
