"""Accumulators of the parts of a record, merged in a tree, agree with one pass to 1e-12."""

import itertools
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from jaxcal.allan import Accumulator
from jaxcal.batch import deviation as deviation_of, reduce
from jaxcal.spectrum import Segments, density

RATE = 100.0


def cuts(n, number, seed):
    """Edges of random parts of unequal lengths, some with a single sample."""
    inner = np.random.default_rng(seed).choice(np.arange(1, n), number - 1, replace=False)
    return np.concatenate([[0], np.sort(inner), [n]])


@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize(("segment", "overlap"), [(64, 0.5), (50, 0.0), (64, 0.75), (33, 0.5)])
def test_spectrum_segments(segment, overlap, channels):
    """The parts are unequal and many are shorter than a segment; every segment across a border is counted once."""
    rng = np.random.default_rng(0)
    y = rng.standard_normal((5000, channels)) + 9.81
    whole = density(y, RATE, method="welch", segment=segment, overlap=overlap, sided=1)
    for number in (1, 2, 3, 8, 200):
        edges = cuts(len(y), number, number)
        parts = []
        for a, b in itertools.pairwise(edges):
            part = Segments(RATE, segment, overlap=overlap, channels=channels, start=int(a))
            for piece in np.array_split(y[a:b], 3):
                part = part.update(piece) if len(piece) else part
            parts.append(pickle.loads(pickle.dumps(part)))  # as to another process
        found = reduce(parts).result(sided=1)
        np.testing.assert_allclose(found.density.reshape(whole.density.shape), whole.density, rtol=1e-12)
        np.testing.assert_array_equal(found.count, whole.count)
        np.testing.assert_allclose(found.edf.reshape(whole.edf.shape), whole.edf, rtol=1e-12)
        np.testing.assert_allclose(found.upper.reshape(whole.upper.shape), whole.upper, rtol=1e-12)


def test_segments_join_without_a_start_where_one_begins():
    y = np.random.default_rng(0).standard_normal(400)
    one, two = (Segments(RATE, 64).update(y[s:e]) for s, e in ((0, 128), (128, 400)))
    np.testing.assert_allclose(one.merge(two).result().density, Segments(RATE, 64).update(y).result().density, rtol=1e-13)


def test_segments_refuse_what_does_not_join(refuses):
    y = np.random.default_rng(0).standard_normal(400)
    part = Segments(RATE, 64).update(y[:100])
    for code, call in (
        ("parts", lambda: part.merge(Segments(RATE, 64).update(y[100:]))),  # without start=100
        ("parts", lambda: part.merge(Segments(RATE, 64, start=90).update(y[90:]))),
        ("parts", lambda: part.merge(Segments(RATE, 32).update(y[100:]))),
        ("parts", lambda: part.merge(Accumulator(RATE))),
        ("gaps", lambda: part.update([1.0, 2.0, np.nan])),
        ("shape", lambda: part.update(np.ones((5, 2)))),
        ("too_short", lambda: Segments(RATE, 64).update([1.0, 2.0, 3.0]).result()),
        ("constant", lambda: Segments(RATE, 16).update(np.ones(64)).result()),
        ("whole", lambda: Segments(RATE, 64, start=-1)),
        ("parts", lambda: reduce([])),
        ("parts", lambda: reduce([[1], [2]])),
    ):
        with refuses(code):
            call()


@pytest.mark.parametrize("kind", ["oadev", "mdev"])
def test_a_record_shared_among_workers(tmp_path, kind, refuses):
    y = np.random.default_rng(0).standard_normal((30_000, 2)).astype(np.float32)
    path = tmp_path / "log.npy"
    np.save(path, y)
    options = {"kind": kind, "m": [1, 7, 50, 600], "chunk": 4096}
    one = deviation_of(path, RATE, **options)
    submitted = []

    class Counted(ThreadPoolExecutor):
        def submit(self, *arguments):
            submitted.append(pickle.loads(pickle.dumps(arguments)))  # as to another process
            return super().submit(*submitted[-1])

    with Counted(3) as pool:
        found = deviation_of(path, RATE, executor=pool, **options)
        few = deviation_of(path, RATE, executor=pool, workers=2, **options)
        assert len(submitted) == 5
        for each in (found, few):
            for name in ("deviation", "lower", "upper", "edf"):
                np.testing.assert_allclose(getattr(each, name), getattr(one, name), rtol=1e-12)
            np.testing.assert_array_equal(each.alpha, one.alpha)
            np.testing.assert_array_equal(each.count, one.count)
        with refuses("executor"):
            deviation_of([path], RATE, executor=pool)
