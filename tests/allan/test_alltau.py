"""Every cluster size of a record at once, against sums in extended precision, and the guard against rounding."""

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.allan import deviation
from jaxcal.allan._kernels import _route as _routes
from jaxcal.allan._kernels._correlation_sums import LARGEST_ERROR, correlation_sums
from jaxcal.allan._kernels._half_range import half_range, size_above, size_below
from jaxcal.allan._kinds import find_kind
from jaxcal.allan._noise_type._identify import identify, noise_types
from jaxcal.noise import Noise

KINDS = ("adev", "oadev", "mdev", "tdev", "hdev", "ohdev")
OVERLAPPED = ("oadev", "mdev", "ohdev")


def phase(y):
    """Phase of a record of rate, in float64, from zero."""
    return np.concatenate([[0.0], np.cumsum(y - y.mean())])


def sums(theta, m, kind):
    """Sums of squared differences in extended precision, as defined."""
    points = np.asarray(theta, dtype=np.longdouble)
    if kind.modified:
        points = np.concatenate([[np.longdouble(0)], np.cumsum(points)])
    total = []
    for size in (int(size) for size in m):
        d = [points[j * size : len(points) - (kind.difference - j) * size] for j in range(kind.difference + 1)]
        d = d[2] - 2 * d[1] + d[0] if kind.difference == 2 else d[3] - 3 * d[2] + 3 * d[1] - d[0]
        d = d if kind.overlapped else d[::size]
        total.append(float(d @ d))
    return np.array(total)


def truth(y, m, name):
    """Deviation at rate 1 in extended precision."""
    kind, m = find_kind(name), np.asarray(m)
    theta = np.concatenate([[np.longdouble(0)], np.cumsum(y.astype(np.longdouble) - y.astype(np.longdouble).mean())])
    return np.sqrt(sums(theta, m, kind) / kind.count(len(y), m) * kind.scale(m, 1.0))


def record(colour, length, seed=0):
    random = np.random.default_rng(seed)
    if colour == "flicker":
        return Noise(B=1.0).simulate(length, 1.0, seed=seed)
    y = random.standard_normal(length)
    return {
        "white": y,
        "random walk": np.cumsum(y),
        "integrated random walk": np.cumsum(np.cumsum(y)),
        "quantisation": np.diff(y, prepend=0),
    }[colour]


@pytest.mark.parametrize(
    ("kind", "colour"),
    [("oadev", "white"), ("oadev", "flicker"), *((kind, "random walk") for kind in ("oadev", "mdev", "ohdev", "adev"))],
)
def test_a_million_samples(kind, colour):
    y = record(colour, 1_000_000)
    found = deviation(y, 1.0, kind=kind, m="all")
    assert len(found.m) == find_kind(kind).largest(len(y))
    chosen = np.unique(np.concatenate([np.round(np.geomspace(1, len(found.m), 12)).astype(int), len(found.m) - np.array([0, 40])])) - 1
    # at the smallest cluster sizes of a random walk the rounding of the phase shows, whichever way it is summed: 1e-8 there
    np.testing.assert_allclose(found.deviation[chosen], truth(y, found.m[chosen], kind), rtol=1e-7)
    for values in (found.lower, found.upper, found.edf):
        assert np.all(np.isfinite(values))
    assert np.all(found.lower <= found.deviation)
    assert np.all(found.upper >= found.deviation)


@pytest.mark.parametrize("name", OVERLAPPED)
@pytest.mark.parametrize("colour", ["white", "flicker", "random walk", "integrated random walk", "quantisation"])
def test_every_cluster_size_of_a_short_record(name, colour):
    kind, theta = find_kind(name), phase(record(colour, 4000))
    m = np.arange(1, kind.largest(4000) + 1)
    found, error = correlation_sums(theta, m, kind)
    formed = np.isfinite(error)
    assert formed.mean() > 0.8
    assert np.all(error[formed] < LARGEST_ERROR)
    off = np.abs(found[formed] / sums(theta, m[formed], kind) - 1.0)
    assert off.max() < 1e-9
    assert np.all(off <= error[formed])


@pytest.mark.parametrize("name", OVERLAPPED)
@hypothesis.settings(max_examples=15, deadline=None)
@hypothesis.given(length=st.integers(2, 2500), seed=st.integers(0, 2**32 - 1), walk=st.sampled_from([0.0, 0.01, 1.0]))
def test_any_length(name, length, seed, walk):
    random = np.random.default_rng(seed)
    theta = phase(random.standard_normal(length) + walk * np.cumsum(random.standard_normal(length)))
    kind = find_kind(name)
    m = np.arange(1, kind.largest(length) + 1)
    if not len(m):
        return
    m = np.unique(random.choice(m, size=max(len(m) // 2, 1)))
    found, error = correlation_sums(theta, m, kind, workers=2)
    good = error < LARGEST_ERROR
    np.testing.assert_allclose(found[good], sums(theta, m[good], kind), rtol=1e-8)
    assert np.all(good | (m < 256) | (kind.count(length, m) < 64))


@pytest.mark.parametrize("length", [2, 3, 4, 5, 7, 63, 64, 65, 127, 128, 129, 511, 513, 1537])
@pytest.mark.parametrize("name", KINDS)
def test_both_quick_routes_on_short_records(name, length):
    kind, theta = find_kind(name), phase(np.random.default_rng(length).standard_normal(length))
    m = np.arange(1, kind.largest(length) + 1)
    if not len(m):
        return
    exact, number = sums(theta, m, kind), kind.count(length, m)
    if kind.overlapped:
        found, error = correlation_sums(theta, m, kind)
        assert np.all(np.isfinite(error) == ((m >= 64) & (number >= 64))) or length > 500
        good = error < LARGEST_ERROR
        np.testing.assert_allclose(found[good], exact[good], rtol=1e-10)
    else:
        found, count = _routes.strided_sums(theta, None, "none", m, number, kind.order)
        np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-25)
        np.testing.assert_array_equal(count, number)


@pytest.mark.parametrize("length", [2, 3, 5, 3100])
@pytest.mark.parametrize("kind", KINDS)
def test_short_records(kind, length):
    y = np.random.default_rng(length).standard_normal(length)
    if find_kind(kind).largest(length) < 1:
        with pytest.raises(DataError, match="needs a record of at least"):
            deviation(y, 1.0, kind=kind, m="all")
        return
    found = deviation(y, 1.0, kind=kind, m="all")
    np.testing.assert_allclose(found.deviation, truth(y, found.m, kind), rtol=1e-9, atol=1e-13)
    np.testing.assert_array_equal(found.count, find_kind(kind).count(length, found.m))


@pytest.mark.parametrize(("a", "c"), [(1, 1), (2, 1), (1, 2)])
@pytest.mark.parametrize("size", [(32, 0), (36, 1), (40, 2), (64, 3)])
def test_half_range_sums_are_their_definition(a, c, size):
    base, doublings = size
    z = np.random.default_rng(0).standard_normal((2, (a + c) * base << doublings))
    found = half_range(z, a, c, base, doublings)
    expected = [[row[: a * m] @ row[c * m : (a + c) * m] for m in range(base << doublings)] for row in z]
    np.testing.assert_allclose(found, expected, atol=1e-11)


def test_sizes_bracket_what_is_asked():
    for limit in range(32, 3000):
        base, doublings = size_below(limit)
        assert limit / 1.2 < base << doublings <= limit
    for limit in range(1, 3000):
        base, doublings = size_above(limit)
        assert limit <= base << doublings <= max(1.2 * limit, 32)


@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_record_has_no_deviation(kind):
    found = deviation(np.full(10_000, 9.81), 1.0, kind=kind, m="all")
    assert np.all(found.deviation == 0.0)


HARD = {
    "huge ramp": lambda n, e: 1e6 * np.arange(n) + e,
    "outlier": lambda n, e: e + 1e12 * (np.arange(n) == n // 3),
    "strong line": lambda n, e: e + 1e6 * np.sin(2 * np.pi * np.arange(n) / 25.0),
    "step": lambda n, e: e + 1e5 * (np.arange(n) > n // 2),
}


@pytest.mark.parametrize("name", OVERLAPPED)
@pytest.mark.parametrize("case", HARD)
def test_what_rounding_would_spoil_is_summed_directly(name, case):
    length = 7000
    y = HARD[case](length, np.random.default_rng(0).standard_normal(length))
    kind, theta = find_kind(name), phase(y)
    m = np.arange(1, kind.largest(length) + 1)
    found, error = correlation_sums(theta, m, kind)
    good = error <= LARGEST_ERROR
    exact = sums(theta, m, kind)
    np.testing.assert_allclose(found[good], exact[good], rtol=LARGEST_ERROR)
    if case == "strong line":  # its multiples of 25 lose the line, and eight digits with it
        assert not good[kind.count(length, m) > 64].all()
    whole = deviation(y, 1.0, kind=name, m="all")
    part = np.unique(np.concatenate([np.geomspace(1, len(m), 30).astype(int), np.arange(25, len(m), 100)]))[:400]
    # the phase of the ramp is rounded to 0.004, which the number of threads that sum it changes
    rtol = 1e-3 if case == "huge ramp" else 1e-8
    np.testing.assert_allclose(whole.deviation[part - 1], deviation(y, 1.0, kind=name, m=part).deviation, rtol=rtol)


def test_a_periodic_record_vanishes_at_its_period():
    y = np.tile([1.0, -3.0, 2.0, 0.0], 5000)
    found = deviation(y, 1.0, m="all")
    assert np.all(found.deviation[3::4] == 0.0)
    assert np.all(found.deviation[0::4] > 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_phase_channels_and_lists(kind):
    random = np.random.default_rng(4)
    y = random.standard_normal((15_000, 2)) + 0.1 * np.cumsum(random.standard_normal((15_000, 2)), axis=0)
    both = deviation(y, 10.0, kind=kind, m="all")
    alone = deviation(y[:, 1], 10.0, kind=kind, m="all")
    for field in ("deviation", "lower", "upper", "edf", "count", "alpha"):
        np.testing.assert_allclose(getattr(both, field)[:, 1], getattr(alone, field), rtol=1e-9, err_msg=field)
    theta = np.concatenate([np.zeros(1), np.cumsum(y[:, 1])]) / 10.0
    np.testing.assert_allclose(deviation(theta, 10.0, kind=kind, m="all", data="phase").deviation, alone.deviation, rtol=1e-7)
    m = random.integers(1, find_kind(kind).largest(15_000) + 1, size=4000)  # in no order, and some of them twice
    some = deviation(y[:, 1], 10.0, kind=kind, m=m)
    np.testing.assert_array_equal(some.m, m)
    np.testing.assert_allclose(some.deviation, alone.deviation[m - 1], rtol=1e-8)
    few = np.unique(m)[:: len(m) // 100]
    exact = deviation(y[:, 1], 10.0, kind=kind, m=few)
    np.testing.assert_allclose(exact.deviation, alone.deviation[few - 1], rtol=1e-8)
    np.testing.assert_allclose(
        exact.edf[exact.alpha == alone.alpha[few - 1]], alone.edf[few - 1][exact.alpha == alone.alpha[few - 1]], rtol=1e-3
    )


@pytest.mark.parametrize(("kind", "data"), [("adev", "rate"), ("adev", "phase"), ("hdev", "rate"), ("oadev", "rate")])
def test_gaps(kind, data):
    y = np.random.default_rng(2).standard_normal(1800)
    y = np.cumsum(y) if data == "phase" else y
    y[[5, 700, 701, 1500]] = np.nan
    found = deviation(y, 1.0, kind=kind, m="all", data=data)
    for part in np.array_split(found.m, 2):
        alone, here = deviation(y, 1.0, kind=kind, m=part, data=data), np.isin(found.m, part)
        np.testing.assert_array_equal(alone.m, part)
        np.testing.assert_array_equal(alone.count, found.count[here])
        np.testing.assert_allclose(alone.deviation, found.deviation[here], rtol=1e-10)


def test_gaps_that_would_take_hours_are_refused(monkeypatch):
    monkeypatch.setattr(_routes, "_MOST", 1e6)
    y = np.random.default_rng(2).standard_normal(3000)
    y[100] = np.nan
    with pytest.raises(DataError, match=r"a record with gaps has no quick sums; use m=\"log\", or take its longest stretch"):
        deviation(y, 1.0, m="all")
    assert len(deviation(y, 1.0).m) > 10


def test_noise_types_are_held_between_those_identified():
    y = Noise(N=1.0, K=0.02).simulate(30_000, 1.0, seed=0)
    kind, theta, m = find_kind("oadev"), phase(y), np.arange(1, 15_001)
    held = noise_types(theta, None, m, kind, len(y), "rate")
    changes = np.flatnonzero(np.diff(held)) + 2  # cluster sizes where a new type begins
    np.testing.assert_array_equal(held[changes - 1], identify(theta, None, changes, kind, len(y), "rate"))
    assert held[0] == 0
    assert held[-1] < 0  # few averages, overlapped: flicker or random walk
    few = m[:500]
    np.testing.assert_array_equal(noise_types(theta, None, few, kind, len(y), "rate"), identify(theta, None, few, kind, len(y), "rate"))
