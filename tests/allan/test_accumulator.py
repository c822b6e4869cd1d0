"""`Accumulator` agrees with `deviation` of the whole record for any chunks, merges and gaps; strides, noise types, bad input."""

import math

import hypothesis
import hypothesis.strategies as st
import jax
import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.allan import Accumulator, _accumulator, _stretch, deviation
from jaxcal.noise import Noise

from .definition import differences, truth

KINDS = ("adev", "oadev", "mdev", "tdev", "hdev", "ohdev")
SOME = ["oadev", "mdev", "ohdev", *(pytest.param(one, marks=pytest.mark.long) for one in ("adev", "tdev", "hdev"))]
M = [1, 2, 3, 5, 8, 13, 21, 34]


@pytest.fixture
def short_pieces(monkeypatch):
    """Process pieces of 64 samples instead of a million, so that short records have many pieces."""
    monkeypatch.setattr(_stretch, "PIECE", 64)


def record(length, seed, gaps, offset):
    random = np.random.default_rng(seed)
    y = offset + random.standard_normal(length) + 0.1 * np.cumsum(random.standard_normal(length))
    for _ in range(gaps):
        start = random.integers(0, length)
        y[start : start + random.integers(1, 8)] = np.nan
    return y


def fed(y, cuts, **options):
    acc = Accumulator(10.0, M, **options)
    for chunk in np.split(y, cuts):
        if len(chunk):
            acc = acc.update(chunk)
    return acc


def same(found, whole):
    np.testing.assert_array_equal(found.m, whole.m)
    np.testing.assert_array_equal(found.count, whole.count)
    np.testing.assert_array_equal(found.skipped, whole.skipped)
    np.testing.assert_allclose(found.deviation, whole.deviation, rtol=1e-12)


LENGTHS = st.integers(102, 400)  # long enough that every cluster size has a difference; tests with a stride use shorter records
CUTS = st.lists(st.integers(0, 400), max_size=12)
SEEDS = st.integers(0, 2**32 - 1)
GAPS = st.integers(0, 4)
OFFSETS = st.sampled_from([0.0, 9.81, -300.0])
slow = hypothesis.settings(max_examples=12, deadline=None, suppress_health_check=[hypothesis.HealthCheck.function_scoped_fixture])


@pytest.mark.parametrize("kind", SOME)
@slow
@hypothesis.given(length=LENGTHS, cuts=CUTS, seed=SEEDS, gaps=GAPS, offset=OFFSETS)
def test_any_chunking_gives_the_deviation_of_the_whole(short_pieces, kind, length, cuts, seed, gaps, offset):
    y = record(length, seed, gaps, offset)
    whole, acc = deviation(y, 10.0, kind=kind, m=M), fed(y, sorted(c for c in cuts if c < length), kind=kind)
    assert acc.samples == length
    found = acc.result()
    same(found, whole)
    equal = found.alpha == whole.alpha
    assert equal.all()
    np.testing.assert_allclose(found.edf[equal], whole.edf[equal], rtol=1e-12)
    np.testing.assert_allclose(found.upper[equal], whole.upper[equal], rtol=1e-12)
    assert found.codes == whole.codes


@pytest.mark.parametrize("kind", SOME)
@slow
@hypothesis.given(length=LENGTHS, cuts=CUTS, borders=st.lists(st.integers(1, 399), max_size=4), seed=SEEDS, gaps=GAPS, left=st.booleans())
def test_merged_parts_give_the_deviation_of_the_whole(short_pieces, kind, length, cuts, borders, seed, gaps, left):
    y = record(length, seed, gaps, 9.81)
    borders = sorted({b for b in borders if b < length})
    parts, begin = [], 0
    for part in np.split(y, borders):
        place = begin if kind in ("adev", "hdev") else None
        parts.append(fed(part, sorted(c for c in cuts if c < len(part)), kind=kind, start=place))
        begin += len(part)
    while len(parts) > 1:  # merge from the left or from the right
        parts = [parts[0].merge(parts[1]), *parts[2:]] if left else [*parts[:-2], parts[-2].merge(parts[-1])]
    same(parts[0].result(), deviation(y, 10.0, kind=kind, m=M))
    more = record(50, seed + 1, 0, 9.81)
    same(parts[0].update(more).result(), deviation(np.concatenate([y, more]), 10.0, kind=kind, m=M))


@pytest.mark.parametrize("kind", ["oadev", "ohdev"])
@slow
@hypothesis.given(length=st.integers(3, 2400), border=st.integers(1, 2399), place=st.booleans(), seed=SEEDS, gaps=GAPS)
def test_strides_are_the_plain_definition_however_chunked_and_merged(short_pieces, kind, length, border, place, seed, gaps):
    """Differences at a stride agree with the definition, for parts with a known start or that begin at a multiple of the stride."""
    m = np.array([1, 100, 300, 704])
    stride = [1, 1, 2, 4]
    y = record(length, seed, gaps, 9.81)
    border = min(border, length - 1) if place else min(border, length - 1) // 4 * 4
    options = {"kind": kind, "exact": 10}
    acc = Accumulator(1.0, m, **options)
    for chunk in (y[:border], y[border:]):
        if len(chunk):
            acc = acc.update(chunk)
    found = [acc]
    if 0 < border < length:
        second = Accumulator(1.0, m, start=border if place else None, **options).update(y[border:])
        found.append(Accumulator(1.0, m, **options).update(y[:border]).merge(second))
    expected = {}
    for size, s in zip(m.tolist(), stride, strict=True):
        if length + 1 > (2 if kind == "oadev" else 3) * size:
            d, total, scale = differences(y, size, kind, stride=s)
            expected |= {size: (math.sqrt(d @ d / len(d) * scale), len(d), total)} if len(d) else {}
    for acc in found:
        if not expected:
            with pytest.raises(DataError):
                acc.result()
            continue
        result = acc.result()
        assert result.m.tolist() == list(expected)
        np.testing.assert_array_equal(result.count, [t[1] for t in expected.values()])
        np.testing.assert_array_equal(result.count + result.skipped, [t[2] for t in expected.values()])
        np.testing.assert_allclose(result.deviation, [t[0] for t in expected.values()], rtol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_channels_threads_and_float32(monkeypatch, kind):
    monkeypatch.setattr(_stretch, "PIECE", 1 << 16)
    monkeypatch.setattr(_accumulator, "PARALLEL_FROM", 1)
    y = (np.random.default_rng(1).standard_normal((300_000, 2)) + np.array([9.81, -2.0])).astype(np.float32)
    y[150_000:150_010, 1] = np.nan
    m = [1, 4, 50, 700, 5_000]
    whole = deviation(y, 50.0, kind=kind, m=m)
    same(Accumulator(50.0, m, channels=2, kind=kind).update(y[:70_001]).update(y[70_001:]).result(), whole)
    place = 123_457
    second = Accumulator(50.0, m, channels=2, kind=kind, start=place).update(y[place:])
    same(Accumulator(50.0, m, channels=2, kind=kind).update(y[:place]).merge(second).result(), whole)


def test_it_is_frozen_and_may_branch():
    y = np.random.default_rng(3).standard_normal(600)
    first = Accumulator(10.0, M).update(y[:300])
    before = first.result()
    a, b = first.update(y[300:]), first.update(y[:300])
    same(first.result(), before)
    same(a.result(), deviation(y, 10.0, m=M))
    same(b.result(), deviation(np.tile(y[:300], 2), 10.0, m=M))
    chunk = y[:300].copy()
    kept = Accumulator(10.0, M).update(chunk)
    chunk[:] = 7.0
    same(kept.result(), before)
    with pytest.raises(AttributeError):
        first.rate = 2.0


def test_a_wandering_mean_costs_no_digits(short_pieces):
    """After an earlier step of the mean by 1e6 times the noise, later differences agree with extended precision."""
    random = np.random.default_rng(4)
    y = random.standard_normal(20_000)
    y[:5000] += 1e6
    y[3000] = np.nan  # so that the part with the step can be separated
    y[4900:5100] = np.nan
    found = Accumulator(1.0, [1, 30]).update(y).result()
    level = np.where(np.arange(len(y)) < 5000, 1e6, 0.0)
    np.testing.assert_allclose(found.deviation, truth(y.astype(np.longdouble) - level, (1, 30), "oadev"), rtol=1e-10)


@pytest.mark.parametrize("term", ["N", "B", "K"])
def test_the_stride_costs_less_than_one_per_cent(term):
    """Compare the exact variances of the mean square for all starts and for every s-th, from the covariance of two differences."""

    lagged = next(part.lagged for name, _, part in Noise().parts if name == term)

    def variance(n, m, s):
        number = (n - 2 * m) // s + 1
        h = s * np.arange(1 - number, number)
        c = lagged(h.astype(float), m, m, 1.0)
        return np.sum((number - np.abs(h / s)) * c**2) / number**2

    for m in (65_537, 131_071):
        s = 2 ** int(np.log2(m // 128)) if m > 65_536 else 1  # the largest power of two with 128 starting points per cluster
        assert m / 256 < s <= m / 128
        for n in (2 * m + s - 1, 2 * m + 40 * s, 3 * m, 8 * m):  # the first length has a single start instead of s
            loss = variance(n, m, s) / variance(n, m, 1) - 1
            assert loss < (0.001 if n > 2 * m + s else 0.01), (m, n, loss)


def test_noise_types_of_a_stream():
    for alpha, noise in {2: Noise(Q=1.0), 0: Noise(N=1.0), -2: Noise(K=1.0)}.items():
        y = np.stack([noise.simulate(20_000, 1.0, seed=s) for s in range(9)], axis=1)
        acc = Accumulator(1.0, [1, 4, 16, 500], channels=9).update(y)
        assert np.median(acc.result().alpha, axis=1).tolist() == [alpha] * 4
        halves = Accumulator(1.0, [1, 4, 16, 500], channels=9).update(y[:7001])
        merged = halves.merge(Accumulator(1.0, [1, 4, 16, 500], channels=9).update(y[7001:]))
        assert np.median(merged.result().alpha, axis=1).tolist() == [alpha] * 4
    assert Accumulator(1.0, [1, 4], alpha=-1).update(y[:, 0]).result().alpha.tolist() == [-1, -1]


def test_grids_go_on_as_far_as_the_record():
    y = np.random.default_rng(5).standard_normal(1000)
    for grid in ("octave", "decade"):
        assert Accumulator(1.0, grid).update(y).result().m.tolist() == deviation(y, 1.0, m=grid).m.tolist()
    found = Accumulator(1.0).update(y).result()
    assert found.m[0] == 1
    assert found.m[-1] == 464
    assert found.findings == ()
    assert Accumulator(1.0, kind="mdev").m[-1] <= 65_536
    assert Accumulator(1.0, [8, 2, 8]).update(y).result().m.tolist() == [8, 2, 8]
    same(Accumulator(1.0, [2, 3]).update(y).result(), deviation(y, 1.0, m=[2, 3]))


def test_a_channel_without_samples_is_said_and_the_others_are_served(refuses):
    y = np.random.default_rng(6).standard_normal((500, 3))
    y[:, 1] = np.nan
    found = Accumulator(1.0, [1, 10], channels=3).update(y[:200]).update(y[200:]).result()
    assert (found.codes, found.findings[0].subject) == ({"empty"}, ("channel 1",))
    assert np.isnan(found.deviation[:, 1]).all()
    assert np.isnan(found.upper[:, 1]).all()
    assert found.count[:, 1].tolist() == [0, 0]
    np.testing.assert_allclose(found.deviation[:, [0, 2]], deviation(y[:, [0, 2]], 1.0, m=[1, 10]).deviation, rtol=1e-12)
    with refuses("no_numbers"):
        Accumulator(1.0).update(np.full(50, np.nan)).result()


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"kind": "mtie"}, "kind"), ({"m": "all"}, "grid"), ({"m": [0]}, "m"), ({"m": [1.5]}, "m"), ({"m": []}, "m"),
        ({"kind": "mdev", "m": [70_000]}, "m"), ({"channels": 0}, "whole"), ({"exact": 0.5}, "whole"), ({"start": -1}, "whole"),
        ({"confidence": 95}, "confidence"), ({"rate": 0.0}, "rate"),
    ],
)  # fmt: skip
def test_messages_about_options(refuses, options, code):
    with refuses(code):
        Accumulator(**({"rate": 1.0} | options))


def test_messages_about_chunks(refuses):
    acc = Accumulator(1.0, [1, 2], channels=2)
    for chunk, code in (
        (np.zeros((0, 2)), "empty"),
        (np.zeros(5), "shape"),
        (np.zeros((5, 3)), "shape"),
        (np.array([["a", "b"]]), "not_numbers"),
        (np.array([[1.0, np.inf]]), "infinite"),
        (np.full((1 << 20, 2), np.inf), "infinite"),
    ):
        with refuses(code):
            acc.update(chunk)
    with refuses("empty"):
        Accumulator(1.0).update([])
    with refuses("no_samples"):
        acc.result()
    with refuses("no_difference"):
        Accumulator(1.0, [1]).update([1.0]).result()
    with refuses("no_difference"):
        Accumulator(1.0, [1]).update([1.0, np.nan, 1.0, np.nan]).result()
    with refuses("traced"):
        jax.jit(lambda y: Accumulator(1.0).update(y).samples)(np.zeros(3))


def test_messages_about_parts_that_do_not_join(refuses):
    y = np.random.default_rng(8).standard_normal(100)
    part = Accumulator(1.0, [1, 2]).update(y)
    for other, code in (
        (Accumulator(1.0, [1, 3]).update(y), "parts"),
        (Accumulator(2.0, [1, 2]).update(y), "parts"),
        (Accumulator(1.0, [1, 2], kind="adev").update(y), "parts"),
        (Accumulator(1.0, [1, 2], channels=2).update(np.zeros((5, 2))), "parts"),
        (Accumulator(1.0, [1, 2], exact=1).update(y), "parts"),
        (Accumulator(1.0, [1, 2], start=99).update(y), "parts"),
        (Accumulator(1.0, [1, 2]), "no_samples"),
        (part.result(), "parts"),
    ):
        with refuses(code):
            part.merge(other)
    with refuses("no_samples"):
        Accumulator(1.0, [1, 2]).merge(part)
    odd = Accumulator(1.0, [1, 7], kind="adev")
    with refuses("parts"):
        odd.update(y).merge(odd.update(y))
    # a cluster size for which both parts are too short is dropped with a message
    far = Accumulator(1.0, [1, 70_000])
    found = far.update(y).merge(far.update(y)).update(np.tile(y, 2000)).result()
    assert found.m.tolist() == [1]
    assert [(one.code, one.facts["tau"]) for one in found.findings] == [("not_followed", "70000 s")]
