"""Invalid input of the particle filter: errors are one line with the value and the expected value."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.trackers import rbpf_update


def good(targets=2):
    """Arguments for one sensor and ten particles."""
    mean = np.tile([2000.0, -1000.0, -100.0, 800.0], (10, targets, 1))
    return {
        "key": 0, "mean": mean, "covariance": np.tile(np.diag([900.0, 900.0, 25.0, 25.0]), (10, targets, 1, 1)),
        "measurements": [[[15033.0, 804.9]] * targets], "pd": np.full((1, targets), 0.9),
        "noise": np.tile(np.diag([100.0, 9.0]), (1, targets, 1, 1)), "sensors": [[3000.0, -16000.0]],
        "clutter_density": 1e-4,
    }  # fmt: skip


BAD = {
    "key": (-1, "key is -1"),
    "key too large": (2**64, r"key is 18446744073709551616, expected an integer in \[0, 2\^64\)"),
    "clutter_density": (0.0, "clutter_density is 0.0, expected finite numbers > 0"),
    "clutter_density too small": (
        1e-320,
        "clutter_density is 1e-320, expected more: the evidence of sensor 0 overflows",
    ),
    "pd": (np.ones((1, 2)), r"pd\[0, 0\] is 1.0, expected probabilities in \(0, 1\)"),
    "pd of another shape": (np.ones(2), r"pd has the shape \(2,\), expected \(1, 2\)"),
    "gate_probability": (0.0, "gate_probability is 0.0"),
    "noise": (-good()["noise"], r"noise\[0, 0\] has the eigenvalue"),
    "covariance": (np.zeros((10, 2, 4, 4)), r"covariance\[0, 0\] has the eigenvalue 0"),
    "sensors": ([[0.0, 0.0]] * 2, r"sensors has the shape \(2, 2\), expected \(1, 2\)"),
    "measurements": ([np.zeros((3, 3))], r"measurements\[0\] has the shape \(3, 3\), expected \(any, 2\)"),
    "mean": (np.full((10, 2, 4), np.nan), r"mean\[0, 0, 0\] is nan, expected finite numbers"),
    "mean of no particles": (np.zeros((0, 2, 4)), "expected at least one particle"),
    "mean of one target for all": (np.zeros((2, 4)), r"mean has the shape \(2, 4\), expected \(any, any, 4\)"),
    "present": ([True], r"present has the shape \(1,\), expected \(2,\)"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named(name):
    value, message = BAD[name]
    with pytest.raises(InputError, match=message) as caught:
        rbpf_update(**(good() | {name.split()[0]: value}))
    assert "\n" not in str(caught.value)


def test_more_targets_than_the_exact_association_takes():
    with pytest.raises(InputError, match="11 targets, expected at most 10 that share measurements of sensor 0"):
        rbpf_update(**good(11))
    assert rbpf_update(**good(10)).ancestors == 10
    assert rbpf_update(**(good(11) | {"present": [True] * 10 + [False]})).ancestors == 10


def test_no_sensor_and_no_return_are_fine():
    s = good()
    nothing = {"measurements": [], "pd": np.empty((0, 2)), "noise": np.empty((0, 2, 2, 2)), "sensors": np.empty((0, 2))}
    assert rbpf_update(**(s | nothing)).log_evidence == 0.0
    missed = rbpf_update(**(s | {"measurements": [[]]}))
    assert missed.log_evidence == pytest.approx(2.0 * np.log(0.1))
    assert (missed.particles.mean == s["mean"]).all()
