import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from wavegym.core.action_sets import Parameter, ParameterBox
from wavegym.core.errors import InputError

BOX = ParameterBox(
    (Parameter("duration", "s", 10e-6, 300e-6), Parameter("sweep", "Hz", -15e6, 15e6, scale="linear")),
)


@given(arrays(np.float64, st.sampled_from([(2,), (5, 2), (3, 4, 2)]), elements=st.floats(-1, 1)))
def test_round_trip(action):
    values = BOX.decode(action)
    assert values.shape == action.shape
    np.testing.assert_allclose(BOX.encode(values), action, rtol=0, atol=1e-12)


@given(st.floats(10e-6, 300e-6), st.floats(-15e6, 15e6))
def test_round_trip_from_physical_values(duration, sweep):
    back = BOX.decode(BOX.encode([duration, sweep]))
    np.testing.assert_allclose(back, [duration, sweep], rtol=1e-12, atol=15e6 * 1e-15)


def test_bounds_and_middle():
    values = BOX.decode([[-1, -1], [1, 1], [0, 0]])
    np.testing.assert_array_equal(values[:2], [[10e-6, -15e6], [300e-6, 15e6]])
    assert values[2, 0] == pytest.approx(np.sqrt(10e-6 * 300e-6), rel=1e-14)  # geometric mean
    assert values[2, 1] == 0


@given(st.floats(-1, 1), st.floats(-1, 1))
def test_never_outside_the_bounds(first, second):
    duration, sweep = BOX.decode([first, second])
    assert 10e-6 <= duration <= 300e-6
    assert -15e6 <= sweep <= 15e6


def test_a_batch_equals_its_elements_bit_for_bit():
    action = np.random.default_rng(0).uniform(-1, 1, (257, 2))
    values = BOX.decode(action)
    singles = np.stack([BOX.decode(a) for a in action])
    np.testing.assert_array_equal(values, singles)
    np.testing.assert_array_equal(BOX.encode(values), np.stack([BOX.encode(v) for v in values]))


def test_a_bound_that_was_rounded_is_taken():
    """The logarithm may have a rounding error, but the result is never outside the box."""
    assert 1.0 - 2.0 * np.finfo(float).eps <= BOX.encode([300e-6 * (1 + 3e-16), 0.0])[0] <= 1.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Parameter("k", "s", 2.0, 1.0), r"range of k is \[2\.0, 1\.0\], expected finite low < high"),
        (lambda: Parameter("k", "s", 1.0, float("nan")), "range of k"),
        (lambda: Parameter("k", "s", 0.0, 1.0), r"low of k \(log scale\) is 0\.0 s, expected a finite number > 0"),
        (lambda: Parameter("k", "s", 0.0, 1.0, scale="liner"), "scale of k is 'liner'.*did you mean 'linear'"),
        (lambda: ParameterBox(()), "parameter box is empty"),
        (lambda: ParameterBox((Parameter("k", "s", 1.0, 2.0),) * 2), "holds 'k' 2 times"),
        (lambda: ParameterBox(("k",)), "holds 'k', expected Parameters"),
        (lambda: BOX.decode([0.0, 1.5]), r"action of sweep is 1\.5, expected \[-1, 1\]"),
        (lambda: BOX.decode([[0.0, 0.0], [np.nan, 0.0]]), "action of duration is nan"),
        (lambda: BOX.decode([0.0]), r"action has shape \(1,\), expected \(\.\.\., 2\) for duration, sweep"),
        (lambda: BOX.encode([1e-3, 0.0]), r"value of duration is 0\.001, expected \[1e-05, 0\.0003\]"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(InputError, match=message):
        make()
