"""Kalman kernels against plain matrices, filterpy, and the laws of the filter."""

from __future__ import annotations

import filterpy.kalman
import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wavegym.core.errors import InputError
from wavegym.trackers import (
    check_positive_definite,
    ekf_predict,
    ekf_update,
    nees,
    predict,
    predict_covariance,
    update,
    update_covariance,
)

SIZES = [(1, 1), (2, 3), (4, 3), (4, 6)]  # each pair is compiled once, with those of test_rank_one.py


def problem(n, m, lead=(), seed=0):
    """x, P, F, Q, y, H, R with leading axes ``lead``."""
    rng = np.random.default_rng([n, m, seed])
    x, y = rng.standard_normal((*lead, n)), rng.standard_normal((*lead, m))
    F, H = rng.standard_normal((*lead, n, n)), rng.standard_normal((*lead, m, n))
    P, Q, R = (oracles.random_covariance(rng, size, lead) for size in (n, n, m))
    return x, P, F, Q, y, H, R


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_equals_plain_matrices_and_filterpy(n, m):
    for seed in range(20):
        x, P, F, Q, y, H, R = problem(n, m, seed=seed)
        peer = filterpy.kalman.KalmanFilter(dim_x=n, dim_z=m)
        peer.x, peer.P, peer.F, peer.Q, peer.H, peer.R = x, P, F, Q, H, R
        predicted, plain = predict(x, P, F, Q), oracles.predict(x, P, F, Q)
        peer.predict()
        for i, theirs in enumerate((peer.x, peer.P)):
            np.testing.assert_allclose(predicted[i], plain[i], rtol=1e-10, atol=1e-10 * np.abs(plain[i]).max())
            np.testing.assert_allclose(predicted[i], theirs, rtol=1e-10, atol=1e-10 * np.abs(plain[i]).max())
        updated, plain = update(*predicted, y, H, R), oracles.update(*predicted, y, H, R)
        peer.update(y + H @ peer.x)
        for i, theirs in enumerate((peer.x, peer.P)):
            scale = np.abs(predicted[i]).max()  # the update subtracts, so rounding is relative to what it starts from
            np.testing.assert_allclose(updated[i], plain[i], rtol=1e-10, atol=1e-10 * scale)
            np.testing.assert_allclose(updated[i], theirs, rtol=1e-10, atol=1e-10 * scale)
        assert (predict_covariance(P, F, Q) == predicted[1]).all()
        assert (update_covariance(predicted[1], H, R) == updated[1]).all()


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_a_batch_equals_its_elements_bit_for_bit(n, m):
    x, P, F, Q, y, H, R = problem(n, m, lead=(7,))
    together = [*predict(x, P, F, Q), *update(x, P, y, H, R)]
    for e in range(7):
        alone = [*predict(x[e], P[e], F[e], Q[e]), *update(x[e], P[e], y[e], H[e], R[e])]
        for whole, one in zip(together, alone, strict=True):
            assert (whole[e] == one).all()


def test_leading_axes_broadcast():
    n, m = 4, 3
    x, P, F, Q, *_ = problem(n, m)
    xs, *_ = problem(n, m, lead=(4, 1))
    _, Ps, *_, Rs = problem(n, m, lead=(5,))
    *_, y, H, _ = problem(n, m)
    means, covariances = predict(xs, Ps, F, Q)
    assert means.shape == (4, 5, n)
    assert covariances.shape == (4, 5, n, n)
    means, covariances = update(xs, Ps, y, H, Rs)
    for i, j in np.ndindex(4, 5):
        mean, covariance = update(xs[i, 0], Ps[j], y, H, Rs[j])
        assert (means[i, j] == mean).all()
        assert (covariances[i, j] == covariance).all()
    assert predict(x, P, F, Q)[0].shape == (n,)


@given(sizes=st.sampled_from(SIZES), seed=st.integers(0, 2**32 - 1))
def test_a_measurement_never_makes_the_covariance_larger(sizes, seed):
    _, P, *_, H, R = problem(*sizes, seed=seed)
    updated = update_covariance(P, H, R)
    assert (updated == updated.T).all()
    scale = np.abs(P).max()
    assert np.linalg.eigvalsh(P - updated).min() >= -1e-12 * scale
    assert np.linalg.eigvalsh(updated).min() >= -1e-12 * scale


def polar(x):
    """Range and azimuth of [x xdot y ydot]."""
    return np.stack([np.hypot(x[..., 0], x[..., 2]), np.arctan2(x[..., 2], x[..., 0])], axis=-1)


def polar_jacobian(x):
    px, py = x[..., 0], x[..., 2]
    r2 = px * px + py * py
    r, zero = np.sqrt(r2), np.zeros_like(px)
    first = np.stack([px / r, zero, py / r, zero], axis=-1)
    return np.stack([first, np.stack([-py / r2, zero, px / r2, zero], axis=-1)], axis=-2)


def test_extended_filter_on_range_and_azimuth_equals_filterpy():
    rng = np.random.default_rng(1)
    F = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
    Q, R = 0.1 * np.kron(np.eye(2), [[1 / 3, 1 / 2], [1 / 2, 1]]), np.diag([25.0, 1e-6])
    x = np.array([[3e3, -20.0, 4e3, 10.0], [-2e3, 5.0, 1e3, 30.0], [8e3, 1.0, -9e3, -100.0]])
    P = np.diag([1e4, 100.0, 1e4, 100.0])[None].repeat(3, axis=0)
    peers = []
    for e in range(3):
        peer = filterpy.kalman.ExtendedKalmanFilter(dim_x=4, dim_z=2)
        peer.x, peer.P, peer.F, peer.Q, peer.R = x[e], P[e], F, Q, R
        peers.append(peer)
    for _ in range(30):
        z = polar(x) + rng.standard_normal((3, 2)) * np.sqrt(np.diag(R))
        x, P = ekf_predict(x, P, lambda x: x @ F.T, lambda x: F, Q)
        x, P = ekf_update(x, P, z, polar, polar_jacobian, R)
        for e, peer in enumerate(peers):
            peer.predict()
            peer.update(z[e], polar_jacobian, polar)
            np.testing.assert_allclose(x[e], peer.x, rtol=1e-10)
            assert oracles.covariance_distance(P[e], peer.P) < 1e-10


def test_a_covariance_that_is_not_positive_definite_is_refused_by_track():
    x, P, _, _, y, H, R = problem(2, 3, lead=(2, 3))
    R[1, 2] = -1e6 * np.eye(3)
    for call in (lambda: update(x, P, y, H, R), lambda: update_covariance(P, H, R)):
        with pytest.raises(InputError, match=r"R\[1, 2\] has the eigenvalue -1e\+06, expected"):
            call()
    P[0, 1] = np.nan
    with pytest.raises(InputError, match=r"P\[0, 1, 0, 0\] is nan, expected finite numbers"):
        update_covariance(P, H, R)
    with pytest.raises(InputError, match=r"^R has the eigenvalue -2, expected"):
        update(np.zeros(1), [[1.0]], np.zeros(1), [[1.0]], [[-2.0]])


def test_positive_definite_matrices_pass_and_others_are_named():
    rng = np.random.default_rng(0)
    good = oracles.random_covariance(rng, 3, (4,))
    assert (check_positive_definite("P0", good) == good).all()
    with pytest.raises(InputError, match="P0 has the eigenvalue -1, expected a positive definite matrix"):
        check_positive_definite("P0", np.diag([1.0, -1.0]))
    with pytest.raises(InputError, match="expected a symmetric matrix"):
        check_positive_definite("P0", [[1.0, 0.5], [0.0, 1.0]])
    with pytest.raises(InputError, match="P0 has the eigenvalue 0"):
        check_positive_definite("P0", np.zeros((2, 2)))


@pytest.mark.parametrize("n", [1, 4])
def test_nees_is_the_squared_mahalanobis_distance(n):
    rng = np.random.default_rng(n)
    error, P = rng.standard_normal((6, 1, n)), oracles.random_covariance(rng, n, (4,))
    values = nees(error, P)
    assert values.shape == (6, 4)
    for i, j in np.ndindex(6, 4):
        expected = error[i, 0] @ np.linalg.solve(P[j], error[i, 0])
        np.testing.assert_allclose(values[i, j], expected, rtol=1e-10)
