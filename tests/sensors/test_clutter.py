"""Gates and the clutter field: Poisson in number, uniform in position, the same for every gate that looks at it."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from scipy import stats

from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.errors import InputError
from wavegym.sensors import gate_probability, gate_volume, inside_gate, union_clutter
from wavegym.sensors.clutter_kernels import ASPECT, add_clutter


def quadratic_form(v, S):
    return v @ np.linalg.solve(S, v)


@pytest.mark.parametrize("gate", [0.5, 2.0, 4.0])
def test_probability_is_chi_squares(gate):
    assert gate_probability(gate) == pytest.approx(stats.chi2.cdf(gate**2, df=2), rel=1e-13)
    S, rng = oracles.random_covariance(np.random.default_rng(1), 2), np.random.default_rng(0)
    inside = inside_gate(rng.multivariate_normal([0, 0], S, 100_000), S, gate).mean()
    pg = gate_probability(gate)
    assert inside == pytest.approx(pg, abs=5 * np.sqrt(pg * (1 - pg) / 100_000))


def test_volume_of_an_upright_ellipse():
    assert gate_volume(np.diag([9.0, 25.0]), 2.0) == pytest.approx(np.pi * 6 * 10, rel=1e-14)


def test_volume_by_counting_points():
    rng, count = np.random.default_rng(2), 200_000
    for S in oracles.random_covariance(rng, 2, (5,)):
        box = 3.0 * np.sqrt(np.diag(S))  # the gate's bounding box has these half widths
        share = inside_gate(rng.uniform(-box, box, (count, 2)), S, 3.0).mean()
        area = share * 4 * box.prod()
        spread = np.sqrt(share * (1 - share) / count) * 4 * box.prod()
        assert gate_volume(S, 3.0) == pytest.approx(area, abs=5 * spread)


def test_volume_of_a_nearly_singular_covariance():
    """1 - rho^2 = 7e-6, as of a long LFM pulse."""
    sigma, rho = np.array([2289.7, 33024.7]), np.sqrt(1 - 7e-6)
    S = np.array([[1, rho], [rho, 1]]) * np.outer(sigma, sigma)
    assert gate_volume(S, 4.0) == pytest.approx(np.pi * 16 * sigma.prod() * np.sqrt(7e-6), rel=1e-9)


def test_inside_means_a_small_quadratic_form():
    rng = np.random.default_rng(3)
    S = oracles.random_covariance(rng, 2, (200,))
    v = rng.standard_normal((200, 2)) * 3 * np.sqrt(np.diagonal(S, axis1=1, axis2=2))
    inside = inside_gate(v, S, 2.5)
    assert list(inside) == [bool(quadratic_form(*pair) <= 2.5**2) for pair in zip(v, S, strict=True)]
    assert 20 < inside.sum() < 180


def test_batches_broadcast_and_equal_their_elements_bit_for_bit():
    rng = np.random.default_rng(4)
    S, v = oracles.random_covariance(rng, 2, (6, 1)), 5 * rng.standard_normal((3, 2))
    gates = np.array([1.0, 2.0, 4.0])
    volume, inside = gate_volume(S, gates), inside_gate(v, S, gates)
    assert volume.shape == inside.shape == (6, 3)
    for i, j in np.ndindex(6, 3):
        assert gate_volume(S[i, 0], gates[j]) == volume[i, j]
        assert inside_gate(v[j], S[i, 0], gates[j]) == inside[i, j]


@pytest.mark.parametrize("gate", [0.0, -1.0, np.inf, np.nan])
def test_gate_outside_its_range(gate):
    for call in (lambda: gate_probability(gate), lambda: gate_volume(np.eye(2), gate)):
        with pytest.raises(InputError, match=r"gate is .*, expected a finite number > 0"):
            call()


@pytest.mark.parametrize(
    "S", [[[1, 2], [2, 1]], [[0, 0], [0, 1]], [[1, 0.5], [0, 1]], [[1, np.nan], [np.nan, 1]], [[np.inf, 0], [0, 1]]]
)
def test_no_covariance(S):
    """The error is one line and names the wrong matrix of a batch."""
    batch = np.stack([np.eye(2), S])
    for call in (lambda: gate_volume(batch, 4.0), lambda: inside_gate(np.zeros(2), batch, 4.0)):
        with pytest.raises(InputError, match=r"^S\[1(, 0, 1|, 0, 0)?\] (has|is) .* expected (a|finite)") as error:
            call()
        assert "\n" not in str(error.value)


def test_shapes_that_do_not_fit():
    with pytest.raises(InputError, match=r"S has shape \(3, 3\), expected \(\.\.\., 2, 2\)"):
        gate_volume(np.eye(3), 4.0)
    with pytest.raises(InputError, match=r"innovation has shape \(3,\), expected \(\.\.\., 2\)"):
        inside_gate(np.zeros(3), np.eye(2), 4.0)
    with pytest.raises(InputError, match="leading axes that broadcast"):
        inside_gate(np.zeros((3, 2)), np.stack([np.eye(2)] * 2), 4.0)


CENTRE = np.array([[100.0, -5.0], [115.0, 0.0], [180.0, 40.0]])  # the first two gates overlap, the third is apart
S = np.array([[[16.0, -3.0], [-3.0, 4.0]], [[25.0, 8.0], [8.0, 9.0]], [[9.0, 0.0], [0.0, 1.0]]])
GATE = 3.0
CHANCE = 1e-4  # probability of a false failure; keys are fixed, so a passed test stays passed
KEYS = range(4000)
POINTS = 400_000


def in_gates(z, centre=CENTRE, covariance=S, gate=GATE):
    """(points, gates): whether each gate holds each point, by solving for the quadratic form."""
    quadratic = [
        np.einsum("pi,pi->p", v, v @ np.linalg.inv(P)) for v, P in zip(z - centre[:, None], covariance, strict=True)
    ]
    return np.stack(quadratic, axis=1) <= gate**2


@pytest.fixture(scope="module")
def union():
    """The area of the union and many uniform points in it, by rejection from the bounding box."""
    reach = GATE * np.sqrt(np.diagonal(S, axis1=1, axis2=2))
    low, high = (CENTRE - reach).min(axis=0), (CENTRE + reach).max(axis=0)
    z = np.random.default_rng(0).uniform(low, high, (10 * POINTS, 2))
    z = z[in_gates(z).any(axis=1)]
    return len(z) / (10 * POINTS) * np.prod(high - low), z


@pytest.fixture(scope="module")
def scans():
    return [union_clutter(key, CENTRE, S, GATE, density=0.05) for key in KEYS]


def append(key, *, covariance=S, present=(True, True, True), gate=GATE, density=0.05, z=None, count=0):
    """The kernel itself: z up to its count."""
    start = np.empty((0, 2)) if z is None else z.copy()
    L = np.linalg.cholesky(covariance)
    z, count = add_clutter(np.uint64(key), CENTRE.copy(), L, np.array(present), gate, density, start, count)
    return z[:count]


@pytest.mark.slow
def test_numbers_are_poisson_with_the_mean_of_the_union(scans, union):
    counts = np.array([len(z) for z in scans])
    mean = 0.05 * union[0]
    assert 0.05 * gate_volume(S, GATE).sum() > 1.1 * mean  # the overlap counts once and is large enough for this test
    score = (counts.sum() - len(counts) * mean) / np.sqrt(len(counts) * mean)
    assert abs(score) < stats.norm.isf(CHANCE)
    dispersion = ((counts - counts.mean()) ** 2).sum() / counts.mean()
    assert CHANCE < stats.chi2.cdf(dispersion, len(counts) - 1) < 1 - CHANCE
    edges = np.unique(stats.poisson.ppf(np.linspace(0.05, 0.95, 15), mean))
    below = stats.poisson.cdf(edges, mean)
    shares = np.diff(below, prepend=0.0, append=1.0)
    bins = np.bincount(np.searchsorted(edges, counts), minlength=len(shares))
    assert stats.chisquare(bins, shares * len(counts)).pvalue > CHANCE


def test_places_are_uniform_in_the_union(scans, union):
    observed, reference = np.concatenate(scans), union[1]
    cells = []
    for axis in (0, 1):
        cells.append(np.unique(np.quantile(reference[:, axis], np.linspace(0, 1, 16))))
        cells[-1][[0, -1]] = -np.inf, np.inf
    tables = np.stack([np.histogram2d(*z.T, bins=cells)[0].ravel() for z in (observed, reference)])
    tables = tables[:, tables[1] >= 200]  # cells that lie at least partly in the union
    assert tables.shape[1] > 60
    assert stats.chi2_contingency(tables).pvalue > CHANCE
    share = [in_gates(z)[:, :2].all(axis=1).mean() for z in (observed, reference)]  # the overlap alone
    assert share[0] == pytest.approx(share[1], abs=5 * np.sqrt(share[1] / len(observed)))


def test_nothing_lies_outside_the_union(scans):
    assert in_gates(np.concatenate(scans), gate=GATE * (1 + 1e-9)).any(axis=1).all()


def test_scans_of_neighbouring_keys_are_uncorrelated(scans):
    counts = [len(z) for z in scans]
    assert stats.pearsonr(counts[1:], counts[:-1]).pvalue > CHANCE
    first = np.array([z[0] for z in scans])
    assert stats.pearsonr(first[1:, 0], first[:-1, 0]).pvalue > CHANCE


def test_one_field_is_uniform_over_boxes_that_are_no_cells():
    """Counts of one key in a rotated grid of boxes are Poisson with a common mean, and neighbours are uncorrelated."""
    box, side = np.array([[3.0, 1.0], [-1.0, 2.0]]), 40  # area 7
    S = np.eye(2)[None] * (2.0 * side * 4.0) ** 2
    z = union_clutter(11, [[1e4, -50.0]], S, 1.0, density=0.3)
    place = np.floor(np.linalg.solve(box.T, (z - [1e4, -50.0]).T)).astype(int).T + side // 2
    counts = np.zeros((side, side))
    np.add.at(counts, tuple(place[((place >= 0) & (place < side)).all(axis=1)].T), 1)
    mean = 0.3 * 7.0
    assert counts.sum() == pytest.approx(counts.size * mean, abs=4 * np.sqrt(counts.size * mean))
    dispersion = ((counts - mean) ** 2).sum() / mean
    assert CHANCE < stats.chi2.cdf(dispersion, counts.size) < 1 - CHANCE
    for here, next_ in ((counts[1:], counts[:-1]), (counts[:, 1:], counts[:, :-1])):
        assert stats.pearsonr(here.ravel(), next_.ravel()).pvalue > CHANCE


def test_the_key_decides():
    assert np.array_equal(union_clutter(7, CENTRE, S, GATE, 0.05), union_clutter(7, CENTRE, S, GATE, 0.05))
    assert not np.array_equal(union_clutter(7, CENTRE, S, GATE, 0.05), union_clutter(8, CENTRE, S, GATE, 0.05))
    assert np.array_equal(union_clutter(2**64 - 1, CENTRE, S, GATE, 0.05), append(2**64 - 1))


def field(key, density, low, high):
    """Every point of the field in the box from ``low`` to ``high``, cell by cell, from the law that the kernel states.

    The Poisson number is SciPy's quantile of the cell's draw 0; its points take two draws each.
    """
    side = np.sqrt(1 / (density * ASPECT)) * np.array([ASPECT, 1.0])
    first, last = np.floor(low / side).astype(int), np.floor(high / side).astype(int)
    z = []
    for column in range(first[0], last[0] + 1):
        for row in range(first[1], last[1] + 1):
            cell = np.uint64(stream(np.uint64(stream(np.uint64(key), column)), row))
            for n in range(int(stats.poisson.ppf(uniform(cell, 0), 1.0))):
                place = column + uniform(cell, 2 * n + 1), row + uniform(cell, 2 * n + 2)
                z.append(side * place)
    return np.array(z).reshape(-1, 2)


def by_row(z):
    """Points in an order of their own."""
    return z[np.lexsort(z.T)]


THIN = np.array([[400.0, -399.0 * 3], [-399.0 * 3, 400.0 * 9]])


@pytest.mark.parametrize("covariance", [S, 0.01 * S, np.array([THIN, S[1], 0.1 * THIN])])
@pytest.mark.parametrize("density", [0.002, pytest.param(0.05, marks=pytest.mark.slow)])
def test_a_gate_has_exactly_the_points_of_the_field_inside_it(covariance, density):
    """Small, large and slanted gates miss no cell: the whole field of the box around them is the reference."""
    reach = GATE * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    low, high = (CENTRE - reach).min(axis=0), (CENTRE + reach).max(axis=0)
    some = 0
    for key in range(20):
        z = field(key, density, low, high)
        expected = z[in_gates(z, covariance=covariance).any(axis=1)]
        np.testing.assert_allclose(by_row(append(key, covariance=covariance, density=density)), by_row(expected))
        some += len(expected)
    assert some > 0


@pytest.mark.parametrize("key", range(5))
def test_all_gates_find_the_same_points(key):
    """A larger gate, or another tracker's gate elsewhere, holds the same points where both look."""
    few = append(key, present=[True, False, False])
    centre, other = CENTRE[:1] + np.array([3.0, -2.0]), np.array([[[30.0, 5.0], [5.0, 12.0]]])
    z = union_clutter(key, centre, other, GATE, 0.05)
    mine, theirs = in_gates(few, centre, other)[:, 0], in_gates(z)[:, 0]
    np.testing.assert_array_equal(by_row(few[mine]), by_row(z[theirs]))
    for wider in (append(key, present=[True, False, False], gate=2 * GATE), append(key, covariance=4 * S)):
        kept = wider[in_gates(wider)[:, 0]]
        assert len(wider) > len(few)
        np.testing.assert_array_equal(by_row(kept), by_row(few))


@pytest.mark.parametrize("key", range(5))
def test_each_gate_adds_the_points_that_earlier_present_gates_do_not_hold(key):
    alone = [append(key, present=np.arange(3) == t) for t in range(3)]
    expected = [z[~in_gates(z)[:, :t].any(axis=1)] for t, z in enumerate(alone)]
    assert np.array_equal(append(key), np.concatenate(expected))
    assert np.array_equal(append(key, present=[False, True, True]), np.concatenate([alone[1], expected[2]]))


@pytest.mark.parametrize("shift", [[900.0, 0.0], [0.0, 900.0], [-700.0, 1100.0]])
def test_gates_apart_hold_what_each_holds_alone(shift):
    """Nothing is found between gates that share columns or rows, or neither."""
    centre, covariance = np.concatenate([CENTRE, CENTRE + shift]), np.concatenate([S, S])
    alone = [union_clutter(7, centre[half], S, GATE, 0.05) for half in (slice(3), slice(3, 6))]
    assert min(map(len, alone)) > 0
    assert np.array_equal(union_clutter(7, centre, covariance, GATE, 0.05), np.concatenate(alone))


def test_appends_to_what_is_there_and_grows():
    """Any capacity and count give the same points behind the existing rows."""
    held = np.arange(8.0).reshape(4, 2)
    many = append(3, density=50.0)
    assert len(many) > 5000
    for capacity in (4, 5, 64, len(many) + 4, 20_000):
        z = np.full((capacity, 2), np.nan)
        z[:4] = held
        grown = append(3, density=50.0, z=z, count=4)
        assert np.array_equal(grown[:4], held)
        assert np.array_equal(grown[4:], many)


def test_a_large_mean_is_met():
    density = 5000 / gate_volume(S[0], GATE)
    counts = [len(union_clutter(key, CENTRE[:1], S[:1], GATE, density)) for key in range(50)]
    assert np.mean(counts) == pytest.approx(5000, abs=5 * np.sqrt(5000 / 50))


def test_no_clutter():
    assert union_clutter(1, CENTRE, S, GATE, 0.0).shape == (0, 2)
    assert union_clutter(1, np.empty((0, 2)), np.empty((0, 2, 2)), GATE, 1.0).shape == (0, 2)
    assert append(1, present=[False] * 3).shape == (0, 2)


def test_the_thinnest_field_has_its_density():
    """Below the density at which cells stop growing, a cell expects less than one point."""
    counts = [len(union_clutter(key, [[0.0, 0.0]], 1e21 * np.eye(2)[None], 1.0, 3e-22)) for key in range(2000)]
    mean = np.pi * 1e21 * 3e-22
    assert np.mean(counts) == pytest.approx(mean, abs=4 * np.sqrt(mean / 2000))


def test_a_gate_without_a_finite_volume_gets_none_and_spares_the_others():
    others = append(1, present=[False, True, True])
    for entry in (np.nan, np.inf):
        L = np.linalg.cholesky(S)
        L[0, 0, :] = L[0, 1, :] = entry
        z, count = add_clutter(np.uint64(1), CENTRE.copy(), L, np.ones(3, bool), GATE, 0.05, np.empty((0, 2)), 0)
        assert np.array_equal(z[:count], others)


GOOD = {"key": 1, "centre": CENTRE, "S": S, "gate": GATE, "density": 0.05}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"key": -1}, r"key is -1, expected an integer in \[0, 2\^64\)"),
        ({"key": 2**64}, "key is 18446744073709551616, expected an integer"),
        ({"key": 0.5}, "key is 0.5, expected an integer"),
        ({"gate": 0.0}, "gate is 0.0, expected a finite number > 0"),
        ({"gate": np.nan}, "gate is nan, expected"),
        ({"density": -1e-4}, "density is -0.0001, expected a finite number >= 0"),
        ({"density": np.inf}, "density is inf, expected"),
        ({"density": 1e9}, r"expected number of clutter points .* \(nearest: 1e\+07\)"),
        ({"centre": CENTRE + 1e14}, "density is 0.05 with cells of area 1 / density, expected gates within 1e\\+12"),
        ({"S": np.array([np.diag([1e20, 1e-20])] * 3)}, "expected gates within .* sizes up to 5e\\+07 clutter cells"),
        ({"S": -S}, r"S\[0\] has the eigenvalue -.*, expected a positive definite matrix"),
        ({"S": S[:2]}, r"centre and S have shapes \(3, 2\) and \(2, 2, 2\), expected \(gates, 2\)"),
        ({"S": S[0]}, r"centre and S have shapes \(3, 2\) and \(2, 2\), expected \(gates, 2\)"),
        ({"centre": CENTRE.T}, r"centre has shape \(2, 3\), expected \(\.\.\., 2\)"),
        ({"centre": np.full((3, 2), np.nan)}, r"centre\[0, 0\] is nan, expected finite numbers"),
    ],
)
def test_bad_input(change, message):
    with pytest.raises(InputError, match=message) as error:
        union_clutter(**(GOOD | change))
    assert "\n" not in str(error.value)
