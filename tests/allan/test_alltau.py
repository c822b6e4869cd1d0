"""All cluster sizes of a record at once agree with sums in extended precision; the guard against rounding errors."""

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest

from jaxcal.allan import deviation
from jaxcal.noise import Noise

from .definition import differences, truth

KINDS = ("adev", "oadev", "mdev", "tdev", "hdev", "ohdev")
OVERLAPPED = ("oadev", "mdev", "ohdev")


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


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "colour"),
    [("oadev", "white"), ("oadev", "flicker"), *((kind, "random walk") for kind in ("oadev", "mdev", "ohdev", "adev"))],
)
def test_a_million_samples(kind, colour):
    y = record(colour, 1_000_000)
    found = deviation(y, 1.0, kind=kind, m="all")
    assert len(found.m) == (len(y) + (kind == "mdev")) // (2 if kind in ("adev", "oadev") else 3)
    chosen = np.unique(np.concatenate([np.round(np.geomspace(1, len(found.m), 12)).astype(int), len(found.m) - np.array([0, 40])])) - 1
    # at the smallest cluster sizes of a random walk, rounding of the phase causes errors of 1e-8 for any order of summation
    np.testing.assert_allclose(found.deviation[chosen], truth(y, found.m[chosen], kind), rtol=1e-7)
    for values in (found.lower, found.upper, found.edf):
        assert np.all(np.isfinite(values))
    assert np.all(found.lower <= found.deviation)
    assert np.all(found.upper >= found.deviation)


@pytest.mark.parametrize("name", OVERLAPPED)
@pytest.mark.parametrize("colour", ["white", "integrated random walk", *(pytest.param(one, marks=pytest.mark.long) for one in (
    "flicker", "random walk", "quantisation",
))])  # fmt: skip
def test_every_cluster_size_of_a_record(name, colour):
    y = record(colour, 12_000)
    found = deviation(y, 1.0, kind=name, m="all")
    assert found.m.tolist() == list(range(1, (12_001 if name == "mdev" else 12_000) // (3 if name != "oadev" else 2) + 1))
    chosen = np.unique(np.concatenate([np.arange(1, 140), np.geomspace(140, len(found.m), 200).astype(int), len(found.m) - np.arange(80)]))
    # rounding of the phase matters at the smallest cluster sizes of the reddest noise
    np.testing.assert_allclose(found.deviation[chosen - 1], truth(y, chosen, name), rtol=1e-6 if "integrated" in colour else 1e-8)


@pytest.mark.parametrize("name", OVERLAPPED)
@hypothesis.settings(max_examples=6, deadline=None)
@hypothesis.given(length=st.integers(8500, 14_000), seed=st.integers(0, 2**32 - 1), walk=st.sampled_from([0.0, 0.01, 1.0]))
@hypothesis.example(length=12_383, seed=0, walk=0.0)
def test_any_length(name, length, seed, walk):
    random = np.random.default_rng(seed)
    y = random.standard_normal(length) + walk * np.cumsum(random.standard_normal(length))
    m = np.unique(random.choice(np.arange(1, length // 3 + 1), size=1500))
    _ = [np.full(size, np.nan) for size in range(17_392, 17_440, 8) for _ in range(20)]  # what memory held before does not matter
    found = deviation(y, 1.0, kind=name, m=m).deviation
    chosen = random.choice(len(m), 60, replace=False)
    np.testing.assert_allclose(found[chosen], truth(y, m[chosen], name), rtol=1e-8)


@pytest.mark.parametrize("length", [2, 3, 5, 3100])
@pytest.mark.parametrize("kind", KINDS)
def test_short_records(refuses, kind, length):
    y = np.random.default_rng(length).standard_normal(length)
    if length < (3 if kind.endswith("hdev") else 2):
        with refuses("too_short"):
            deviation(y, 1.0, kind=kind, m="all")
        return
    found = deviation(y, 1.0, kind=kind, m="all")
    np.testing.assert_allclose(found.deviation, truth(y, found.m, kind), rtol=1e-9, atol=1e-13)
    assert found.count.tolist() == [len(differences(y, int(m), kind)[0]) for m in found.m]


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
    whole = deviation(y, 1.0, kind=name, m="all")
    part = np.unique(np.concatenate([np.geomspace(1, len(whole.m), 30).astype(int), np.arange(25, len(whole.m), 100)]))[:400]
    # the phase of the ramp has rounding errors of 0.004, which depend on the number of threads
    rtol = 1e-3 if case == "huge ramp" else 1e-8
    np.testing.assert_allclose(whole.deviation[part - 1], deviation(y, 1.0, kind=name, m=part).deviation, rtol=rtol)


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
    m = random.integers(1, alone.m[-1] + 1, size=4000)  # in random order, with repetitions
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


def test_gaps_that_would_take_hours_are_refused(refuses):
    y = np.random.default_rng(2).standard_normal(2_000_000)
    y[100] = np.nan
    with refuses("too_many"):
        deviation(y, 1.0, m="all")
    assert len(deviation(y[:3000], 1.0).m) > 10
