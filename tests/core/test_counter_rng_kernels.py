"""The counter-based generator against SplitMix64's published outputs, SciPy and the distributions it must have."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special, stats

from wavegym.core.counter_rng_kernels import (
    cosines_and_sines,
    exponential,
    fill_normals,
    mix,
    normal,
    normal_quantile,
    stream,
    uniform,
)

WORD = 2**64
INTEGERS = st.integers(0, WORD - 1)
COUNT = 20_000
CHANCE = 1e-4  # seeds are fixed: a test that holds once holds always


def plain_mix(x):
    z = x % WORD
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 % WORD
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB % WORD
    return z ^ (z >> 31)


def draws(function, key, count=COUNT):
    return np.array([function(np.uint64(key), i) for i in range(count)])


def test_published_outputs_of_splitmix64():
    published = [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]
    states = [(1234567 + (i + 1) * 0x9E3779B97F4A7C15) % WORD for i in range(5)]
    assert [mix(np.uint64(s)) for s in states] == published
    assert [uniform(np.uint64(1234567), i) for i in range(5)] == [((z >> 12) + 0.5) / 2**52 for z in published]


@given(INTEGERS, INTEGERS)
def test_same_as_plain_integers(key, i):
    assert mix(np.uint64(key)) == plain_mix(key)
    assert stream(np.uint64(key), np.uint64(i)) == plain_mix(key + (i + 1) * 0xD1342543DE82EF95)
    bits = plain_mix(key + (i + 1) * 0x9E3779B97F4A7C15) >> 12
    assert uniform(np.uint64(key), np.uint64(i)) == (2 * bits + 1) / 2**53


def test_signed_integers_wrap_instead_of_turning_into_floats():
    assert mix(-1) == plain_mix(WORD - 1)
    assert stream(-3, -2) == stream(np.uint64(WORD - 3), np.uint64(WORD - 2))
    assert uniform(5, -7) == uniform(np.uint64(5), np.uint64(WORD - 7))


def unmix(z):
    """The inverse of mix, to find the counter that gives chosen bits."""
    z = z ^ (z >> 31) ^ (z >> 62)
    z = z * pow(0x94D049BB133111EB, -1, WORD) % WORD
    z = z ^ (z >> 27) ^ (z >> 54)
    z = z * pow(0xBF58476D1CE4E5B9, -1, WORD) % WORD
    return z ^ (z >> 30) ^ (z >> 60)


@pytest.mark.parametrize(("bits", "expected"), [(0, 2.0**-53), (WORD - 1, 1 - 2.0**-53)])
def test_smallest_and_largest_uniform_are_inside_the_open_interval(bits, expected):
    key = np.uint64((unmix(bits) - 0x9E3779B97F4A7C15) % WORD)
    assert uniform(key, 0) == expected
    assert 0.0 < uniform(key, 0) < 1.0
    assert exponential(key, 0) == -np.log(expected) > 0.0
    assert normal(key, 0) == pytest.approx(special.ndtri(expected), rel=1e-13)
    assert abs(normal(key, 0)) == pytest.approx(8.209536151601387, rel=1e-13)


def test_normal_quantile_is_scipys():
    rng, powers = np.random.default_rng(0), 2.0 ** -np.arange(1.0, 54.0)
    edges = np.array([0.075, 0.925, np.exp(-25.0)])  # where the approximation changes
    p = np.concatenate([rng.random(20_000), powers, 1 - powers, edges, np.nextafter(edges, 0), [1e-100, 5e-324]])
    np.testing.assert_allclose([normal_quantile(x) for x in p], special.ndtri(p), rtol=1e-13, atol=0)
    limits = [normal_quantile(x) for x in (0.0, 1.0, 0.5, -0.1, 1.1, np.nan)]
    np.testing.assert_array_equal(limits, [-np.inf, np.inf, 0.0, np.nan, np.nan, np.nan])


@pytest.mark.parametrize("key", [0, 1, 2**63, 0x9E3779B97F4A7C15])
@pytest.mark.parametrize(("function", "law"), [(uniform, "uniform"), (exponential, "expon"), (normal, "norm")])
def test_distributions(function, law, key):
    assert stats.kstest(draws(function, key), law).pvalue > CHANCE


def substream(key, *numbers):
    """stream(stream(key, a), b), ...: seen from Python a uint64 comes back as an int, too big to go in as one."""
    for a in numbers:
        key = np.uint64(stream(np.uint64(key), a))
    return key


def test_first_draw_of_consecutive_streams_is_uniform_too():
    sample = [uniform(substream(0, a), 0) for a in range(COUNT)]
    assert stats.kstest(sample, "uniform").pvalue > CHANCE


def test_neighbours_are_uncorrelated():
    """Consecutive draws, the same draw of consecutive keys, streams and steps of a chain; and their squares."""
    count = COUNT
    base = draws(normal, 0, count + 1)
    keys = np.array([normal(np.uint64(a), 0) for a in range(count + 1)])
    streams = np.array([normal(substream(0, a), 0) for a in range(count + 1)])
    chained = np.array([normal(substream(0, a, 1), 0) for a in range(count + 1)])
    pairs = [(base[1:], base[:-1]), (keys[1:], keys[:-1]), (streams[1:], streams[:-1]), (chained[1:], chained[:-1])]
    pairs += [(base, keys), (base, streams), (streams, chained), (streams, draws(normal, 1, count + 1))]
    for a, b in pairs:
        assert stats.pearsonr(a, b).pvalue > CHANCE
        assert stats.pearsonr(a * a, b * b).pvalue > CHANCE


def test_pairs_fill_the_square_evenly():
    sample = draws(uniform, 7, 2 * COUNT)
    counts, _, _ = np.histogram2d(sample[::2], sample[1::2], bins=16, range=[[0, 1], [0, 1]])
    assert stats.chisquare(counts.ravel()).pvalue > CHANCE


def test_every_bit_of_a_key_changes_half_the_bits_of_its_draws():
    for bit in range(64):
        flips = [mix(substream(k, 3)) ^ mix(substream(k ^ (1 << bit), 3)) for k in range(200)]
        assert np.mean([f.bit_count() for f in flips]) == pytest.approx(32, abs=6 * 4 / np.sqrt(200))


@pytest.mark.parametrize("first", [0, 10])
def test_normals_in_bulk_are_box_and_muller_s(first):
    """Against NumPy's logarithm and complex exponential of the same draws, to rounding; and their distribution."""
    own = np.empty(COUNT)
    fill_normals(np.uint64(5), first, own)
    u = np.array([uniform(np.uint64(5), first + i) for i in range(COUNT)])
    expected = np.sqrt(-2.0 * np.log(u[::2])) * np.exp(2j * np.pi * (u[1::2] - 0.5))
    np.testing.assert_allclose(own[::2] + 1j * own[1::2], expected, rtol=0.0, atol=1e-14)
    assert stats.kstest(own, stats.norm.cdf).pvalue > CHANCE
    assert abs(np.corrcoef(own[::2], own[1::2])[0, 1]) < 4.0 / np.sqrt(COUNT / 2)


def test_cosines_and_sines():
    """Over many turns against NumPy."""
    turns = np.concatenate([np.linspace(-3.0, 3.0, 4001), np.random.default_rng(0).uniform(-0.5, 0.5, 4000)])
    cosines, sines = np.empty(turns.shape), np.empty(turns.shape)
    cosines_and_sines(turns, cosines, sines)
    np.testing.assert_allclose(cosines + 1j * sines, np.exp(2j * np.pi * turns), rtol=0.0, atol=5e-15)
