"""Parameters that do not go together, or that no radar could have, are refused in one line when a system is made.

Bounds of single numbers are those of tests/systems/test_extreme_parameters.py.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.evaluation.play import make_task
from wavegym.targets import constant_velocity
from wavegym.trackers.imm import ImmKalman
from wavegym.trackers.protocol import ExtendedKalman

FOUR = (0.0,) * 4
REFUSED: dict[str, list[tuple[dict[str, Any], str]]] = {
    "AgileClutter": [
        ({"births": (0,)}, "expected 2 steps"),
        ({"births": (32, 33), "horizon": 32}, "least of births is 32, expected .*nearest: 31"),
        ({"starts": (FOUR,) * 11, "births": (0,) * 11}, "number of targets .* is 11.*nearest: 10"),
        ({"sensors": ()}, "number of sensors is 0"),
        ({"weights": FOUR}, "sum of weights is 0.0"),
        ({"laws": ("hfn",)}, "did you mean 'hfm'"),
        ({"laws": ("hfm", "hfm:0.5")}, "2 times"),
        ({"laws": ("pfm:1",)}, "shape kappa of 'pfm' is 1.0.*folds"),
        ({"laws": ("hfm:-1",)}, "shape g of 'hfm' is -1.0"),
        ({"carrier_hz": 1e6}, "folds through zero"),
        ({"durations": ()}, "library is empty"),
        ({"horizon": 33}, "horizon is 33 steps.*nearest: 32"),
        ({"clutter_density": 1e6}, "clutter_density is 1000000.0 s/m\\^2, expected .*nearest: "),
        ({"prior_variance": (1e8,) * 4}, r"clutter_density is 0\.0001 s/m\^2, .* \(nearest: .*\): a target of prior"),
        ({"eclipsing": "perhaps"}, "eclipsing is 'perhaps'"),
        ({"tracker": "jdpa"}, "did you mean 'jpda'"),
        ({"tracker": 3}, "expected an object with predict"),
        ({"tracker": "no.such:Thing"}, "cannot be loaded"),
        (
            {"tracker": ImmKalman((constant_velocity(1.0, 1.0),))},
            "ImmKalman, expected one without a memory",
        ),
        ({"truth": {"clutter": 1e-3}}, "did you mean 'clutter_density'"),
        ({"truth": {"q": -1.0}}, "q is -1.0"),
    ],
    "BeamAllocation": [
        ({"tracker": "kalman"}, "tracker is 'kalman'.*'jpda'"),
        ({"action": "library"}, "action is 'library'.*'joint'"),
        ({"births": (0, 1, 0)}, r"births is \(0, 1, 0\), expected 0"),
        ({"births": (0, 0)}, "expected 3 steps"),
        ({"lifetime": 59}, "horizon is 60 steps.*nearest: 59"),
        ({"horizon": 61}, "horizon is 61 steps.*nearest: 60"),
        (
            {"durations": (1e-4,)},
            r"durations is \(0.0001,\), sweeps is .*, counts is \(1, 8\), intervals .*, expected one",
        ),
        ({"windows": ((3, 0, 5),)}, r"target of hidden window \(3, 0, 5\) is 3.*nearest: 2"),
        ({"hidden": (9, 5)}, r"hidden is \(9, 5\).*nearest: \(5, 9\)"),
        (
            {
                "durations": (1e-4,) * 40,
                "sweeps": tuple(1e6 * k for k in range(1, 41)),
                "counts": (1,) * 40,
                "intervals": (1e-3,) * 40,
            },
            "number of joint actions is 14400",
        ),
        ({"counts": (1, 8000)}, r"8000 x .* takes 1\.99976 s, .* the step, 1\.0 s \(nearest: 4000 pulses\)"),
        ({"counts": (1, 0)}, "counts.1 is 0, .*nearest: 1"),
        ({"intervals": (250e-6, 1e-4)}, r"folds at 14989.6 m, .* farthest target, 31800.2 m \(nearest: interval"),
    ],
    "CameraSlew": [
        ({"tracker": "kalmann"}, "expected one of 'kalman', 'package.module:name'; did you mean 'kalman'"),
        ({"sector": (1.0, -1.0)}, r"sector is \(1, -1\).*nearest: \(-1, 1\)"),
        ({"ranges": (2e3, 1e3)}, "ranges is"),
        ({"q": (2.0, 1.0)}, r"q is \(2, 1\)"),
        ({"shown": (0, 4)}, "shown is 0 steps"),
        ({"hidden": (4, 2)}, "hidden is"),
        ({"windows": ((4, 0, 3),)}, r"target of hidden window \(4, 0, 3\) is 4.*nearest: 3"),
        ({"prf": 100.0}, "dwell of 128 pulses at 100 Hz"),
        ({"prf": 1e8}, r"interval \(PRI\) is 1e-08 s, .*PRF < 2e\+06"),
        ({"platforms": ()}, "number of platforms is 0"),
        ({"truth": {"slew": 1.0}}, r"truth has 'slew', expected one of q, turn_rate, .*detection"),
        ({"truth": {"detection": 1.5}}, r"detection is 1\.5"),
    ],
    "SharedSpectrum": [
        ({"users": ("statik",)}, "kind of user is 'statik'.*did you mean 'static'"),
        ({"users": ("static",) * 17}, "users are 17 in 8 channels, expected at most two a channel"),
        ({"channels": 0}, "channels is 0, expected an integer >= 1"),
        ({"history": 101}, "history is 101 steps, expected at most those of the episode \\(nearest: 100\\)"),
        ({"sensing_delay": 16}, "sensing_delay is 16 steps, expected fewer than history \\(nearest: 15\\)"),
        ({"predictor": "contexttree:4"}, "predictor is 'contexttree', expected one of .*'context-tree'"),
        ({"predictor": "lags"}, "predictor is 'lags', expected lags: and 1 to 100 steps"),
        ({"duty": (0.5, 1.5)}, "expected shares of at most 1"),
        ({"user_power": (25.0, 15.0)}, r"user_power is .*nearest: \(15, 25\)"),
        ({"start_range": (5e3, 4e4)}, r"start_range is .*expected none nearer than 5995\.85 m"),
        ({"start_range": (1e4, 7e4)}, "folds at 59958"),
        ({"start_speed": (-200.0, 200.0)}, "folds"),
        ({"pulses": 700}, "takes .* the step"),
        ({"receiver": "matchd"}, "did you mean 'matched'"),
        ({"weights": (0.0, 0.0)}, "sum of weights is 0.0"),
        ({"cells": 65}, "cells is 65"),
        ({"cells": 2}, r"cells is 2, expected more cells, .* of 0\.0001 \(nearest: 3\)"),
        ({"sensing": 5.0}, r"sensing is 5.0 dB, expected a finite number <= 4"),
        ({"truth": {"users": ("static",)}}, "truth has 'users', expected one of reference_range"),
    ],
    "EnergyBudget": [
        ({"budget": 0.003}, "budget is 0.003 a step, expected .*cheapest pulse"),
        ({"budget": 2.1}, "nearest: 2"),
        ({"durations": (1e-5, 3.1415926535e-5)}, "multiples of one unit"),
        ({"laws": ("lfm", "pfm:3")}, "laws is"),
        ({"births": (3,)}, "births is"),
        ({"tracker": "kalman"}, "tracker is 'kalman'"),
        ({"action": "box"}, "action is 'box'"),
        ({"windows": ((1, 2),)}, "windows"),
    ],
    "EnergyBudgetKnown": [
        ({"windows": ((70, 72),)}, "last step of hidden window"),
        ({"windows": ((0, 71),)}, "at least one step"),
        ({"hidden": (5, 3)}, r"hidden is \(5, 3\), expected"),
    ],
    "KershawEvans": [
        ({"weights": (1.0,)}, "expected 2 numbers"),
        ({"weights": (0.0, 0.0)}, "sum of weights"),
        ({"model": "ca"}, "expected 3 numbers"),
        ({"model": "cw"}, "expected one of 'cv', 'ca'"),
        ({"sweeps": (1e6, 1e6)}, "2 times"),
        ({"start_range": (2e4, 1e4)}, "start_range is"),
        ({"tracker": "imn"}, "expected one of 'kalman', 'imm', 'package.module:name'; did you mean 'imm'"),
        ({"tracker": 5}, "tracker is 5, expected an object with predict"),
        ({"densities": ()}, "densities is ()"),
        ({"dt": 0.5, "durations": (1.0,)}, r"takes 3.64277 s, .*\(nearest: 0.5 s of transmission\)"),
        (
            {"reference_range": 1e9},
            r"reference_range is 1000000000\.0 m: .* expected at most 1e\+12, .* \(nearest: 2\.98e\+07 m",
        ),
    ],
    "SectorSetup": [
        ({"tracker": ExtendedKalman}, r"expected an object with predict.*nearest: OneByOne\(filter\)"),
        ({"receivers": ()}, r"receivers is \(\): Tuple should have at least 1 item"),
        ({"waveforms": ()}, r"waveforms is \(\): Tuple should have at least 1 item"),
        ({"waveforms": ((2, 250e-6, 15e-6, 1e6),) * 2}, "expected each waveform once"),
        ({"waveforms": ((2, 250e-6, 50e-6, 1e6),)}, r"interval is 0.00025 s, expected one in which the pulse falls"),
        ({"windows": ((4, 0, 3),)}, r"target of hidden window \(4, 0, 3\) is 4.*nearest: 3"),
        ({"hidden": (5, 4)}, r"hidden is \(5, 4\)"),
        ({"q": (2.0, 1.0)}, r"q is \(2, 1\).*nearest: \(1, 2\)"),
        ({"region": ((1.0, 0.0), (0.0, 1.0))}, r"x of region is \(1, 0\)"),
        ({"nearest_range": 9e3}, "nearest_range is 9000.0 m.*nearest: 5650"),
        ({"weights": FOUR}, "sum of weights is 0.0"),
        ({"truth": {"waveforms": ((1, 1e-3, 1e-6, 0.0),)}}, r"truth has 'waveforms', expected one of"),
    ],
    "SectorSetupCity": [
        ({"city": "promenad"}, "city is 'promenad', expected one of"),
        ({"illuminator": (15.0, 80.5)}, "inside a building"),
        ({"receivers": ((0.0, 0.0), (15.0, 80.5))}, "inside a building"),
    ],
    "RfEo": [
        ({"prf": (1e5, 1e3)}, r"prf is \(100000, 1000\), expected \(low, high\); nearest: \(1000, 100000\)"),
        ({"pixel_angle": (1e-3, 1e-5)}, r"pixel_angle is .*nearest: \(1e-05, 0.001\)"),
        ({"prf": (1e4, 1e4)}, "expected low < high"),
        ({"prf": (1e3, 1e8)}, r"interval \(PRI\) is 1e-08 s, .* expected room for the pulse.*PRF < 2e\+07"),
        ({"fft_length": 2048}, r"dwell of 2048 pulses at 1000 Hz is 2.048 s, .* at most dt = 1 s .*prf: 2048 Hz"),
        ({"dt": 0.1}, "dwell of 128 pulses .*nearest prf: 1280 Hz"),
        ({"prior_variance": (1e20, 25.0, 1e20, 25.0)}, r"prior_variance is up to 1e.20, expected at most 1e.12 times"),
        ({"pixel_angle": (1e-5, 1e-2)}, "high of pixel_angle is 0.01 rad.*nearest: 0.00628319"),
        ({"pixels": 2000}, "high of pixel_angle is 0.00628319 rad.*nearest: 0.00314159"),
        ({"platforms": ()}, "number of platforms is 0"),
        ({"starts": ()}, "number of starts is 0"),
        ({"platforms": ((0.0, 0.0),) * 65}, r"number of platforms is 65.*nearest: 64"),
        ({"starts": (FOUR,) * 65}, r"number of starts is 65.*nearest: 64"),
        ({"looks": (0.0,)}, r"looks is \(0.0,\), expected 2 angles, one for each platform"),
        ({"weights": FOUR}, "sum of weights is 0.0"),
        ({"weights": (1.0, 1.0)}, "weights is .*expected 4 elements, not 2"),
        ({"weights": np.diag([1.0, 1.0, 1.0, -2.0])}, r"weights has the eigenvalue -2, .* \(nearest eigenvalue: 0\)"),
        ({"weights": np.eye(4) + np.eye(4, k=1)}, r"\[0, 1\] = 1 and \[1, 0\] = 0, expected a symmetric matrix"),
        ({"weights": np.eye(3)}, r"weights has rows of \[3, 3, 3\] elements, expected 4 numbers, or 4 rows of 4"),
        ({"weights": np.zeros((4, 4))}, "sum of weights is 0.0"),
        ({"penalty": "logistc"}, "penalty is 'logistc'.*'logistic'"),
        ({"tracker": "ekff"}, "tracker is 'ekff', expected one of 'ekf', 'package.module:name'; did you mean 'ekf'"),
        ({"tracker": ExtendedKalman}, r"tracker is <class .*, expected an object with predict.*nearest: OneByOne"),
        (
            {"tracker": ImmKalman((constant_velocity(1.0, 1.0),)), "births": (0, 9)},
            r"tracker ImmKalman has a memory, expected a tracker without begin\(.*\), because targets come and go",
        ),
        ({"action": "joint", "platforms": ((0.0, 0.0),) * 8}, r"joint actions is 16\^8.*nearest action: 'library'"),
        ({"births": (0,)}, r"births is \(0,\), expected 2 steps, one for each of starts"),
        ({"births": (0, 1000)}, "greatest of births is 1000.*nearest: 999"),
        ({"turns": 4}, r"turns is 4, expected an odd number.*nearest: 5"),
        (
            {"action": "joint", "points": (8, 1, 8), "slew_rate": 1.0},
            r"number of joint actions is 320\^2 from points \(8, 1, 8\) with 5 turns.*nearest action: 'library'",
        ),
        (
            {"points": (200, 1, 200), "turns": 3, "slew_rate": 1.0},
            r"120000 settings from points \(200, 1, 200\) with 3 turns",
        ),
        (
            {"truth": {"pixel_angle": (1e-5, 1e-3)}},
            "truth has 'pixel_angle', expected one of q, turn_rate, fft_length, pixels, prior_variance, nearest_range",
        ),
    ],
    "RfEoFar": [
        ({"notch": 20.0}, r"notch is 20 m/s, .*half .* 14.99 m/s at 2000 Hz \(nearest: 14.84, or a prf from"),
        ({"prf": (1e3, 1e5)}, r"notch is 10 m/s, expected .* 7.495 m/s at 1000 Hz"),
        ({"duty": 0.6}, r"duty is 0.6, expected a finite number < 0.5 \(nearest: just below it\)"),
        ({"out_of_view": "inflated"}, r"out_of_view is 'inflated', expected 'missing' with folding"),
        ({"as_printed": True}, r"as_printed is True, expected False with folding"),
    ],
    "Urban": [
        ({"tracker": ExtendedKalman()}, r"tracker is <.*, expected one of 'vsimm', 'ncv'"),
        ({"city": "intersektion"}, "city is 'intersektion', expected one of 'intersection'"),
        ({"transmitters": ((2000.0, 1600.0),)}, "inside a building"),
        ({"transmitters": ((0.0, 0.0),)}, r"transmitters has \(0\.0, 0\.0\), .* m from the nearest road"),
        ({"transmitters": ()}, r"transmitters is \(\), expected at least one"),
        ({"receivers": ((1e6, 1e6), (2078.0, 1467.0))}, "m from the nearest road, expected at most twice the reach"),
        ({"receivers": ((2088.0, 1475.0),)}, "expected at least two"),
        ({"path": ((30.0, 0.0, 0.3),)}, "path leads into a building"),
        ({"start": (2000.0, 1600.0)}, "path (begins in|leads into) a building"),
        ({"durations": ()}, "library is empty"),
        ({"pulses": 400}, r"takes 0.399005 s, expected at most the step, 0.25 s \(nearest: 250 pulses\)"),
        ({"arrivals": ()}, "arrivals is"),
        ({"arrivals": tuple(range(13))}, "arrivals has 13 targets, expected at most 12"),
        ({"charged": 9}, "charged is 9, expected 1 to 8 slots"),
        ({"tracker": "imm"}, "tracker is 'imm'"),
        ({"weights": (0.0, 0.0, 0.0)}, r"sum of weights is 0\.0"),
        ({"clutter_density": 1.0}, "false returns of a pair in a scan are 1.124e"),
        ({"array_axes": (0.0,)}, "array_axes has 1 azimuths, expected 2, one for each receiver"),
        ({"fluctuation": "swerling5"}, "fluctuation.*swerling5"),
        ({"error_snr": "realized"}, "error_snr is 'realized', expected one of 'mean', 'realised'; did you mean"),
        ({"truth": {"arrivals": (0.0,)}}, "truth has arrivals of 1 targets, expected 2"),
    ],
    "UrbanSignal": [
        ({"false_alarm": 1e-3}, r"false_alarm is 0\.001, expected None with fidelity='signal'"),
        ({"searched": 2}, "searched is 2, expected 3 with fidelity='signal'"),
        ({"pulses": 10**8}, r"takes 100000 s, expected at most the step, .* \(nearest: 250 pulses\)"),
    ],
    "MultifunctionRadar": [
        ({"tracker": "ekf"}, "tracker is 'ekf', expected one of 'imm'"),
        ({"speeds": (300.0, 100.0)}, r"speeds is .* expected the least first \(nearest: \(100.0, 300.0\)\)"),
        ({"sectors": 200}, r"sectors is 200, expected each as wide as a beam or wider \(nearest: 41\)"),
        ({"interval": 100e-6}, "range of 16 pulses folds at 14989.6 m"),
        ({"nearest": 1e3}, r"nearest is 1000.0 m, expected a number in \[4496.89"),
        ({"pulses": (16, 48)}, r"bursts is \(1, 1, 1, 4\), expected a number for each of the pulses \(16, 48\)"),
        ({"pulses": (16, 16), "bursts": (2, 2)}, r"pulses is \(16, 16\), expected no two dwells alike"),
        ({"false_alarms": (0.1, 2.0)}, r"false_alarms.1 is 2.0, expected a number in \[1e-09, 1\]"),
        (
            {"pulses": (2000,), "bursts": (1,)},
            r"sample is 0.6 s, expected the longest dwell or more \(nearest: 0.641\)",
        ),
    ],
}


@pytest.mark.parametrize(
    ("name", "parameters", "words"), [(name, *row) for name, rows in REFUSED.items() for row in rows]
)
def test_parameters_are_refused_in_one_line(name, parameters, words):
    with pytest.raises(InputError, match=words) as caught:
        make_task(name, parameters)
    assert "\n" not in str(caught.value)


def test_the_nearest_reference_range_is_accepted():
    make_task("KershawEvans-v0", {"reference_range": 4.82e6})
