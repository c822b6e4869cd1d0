"""Accumulators of the parts of a record, merged in a tree, agree with one pass to 1e-12."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from jaxcal.batch import deviation as deviation_of, reduce

RATE = 100.0


def test_what_is_no_part_is_refused(refuses):
    for parts in ([], [[1], [2]]):
        with refuses("parts"):
            reduce(parts)


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
