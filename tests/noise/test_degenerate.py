"""Records without noise, of a moving sensor, nearly empty or very short give finite numbers or a refusal with a reason."""

import warnings

import jax
import numpy as np
import pytest

import jaxcal

KINDS = {
    "white": lambda t, w, r: w,
    "sine": lambda t, w, r: 1e-9 * w + np.sin(2 * np.pi * r.uniform(0.1, 30.0) * t),
    "walk of a walk": lambda t, w, r: np.cumsum(np.cumsum(w)),
    "coarse": lambda t, w, r: np.round(0.3 * w),
    "half missing": lambda t, w, r: np.where(r.random(len(t)) < 0.5, np.nan, w),
    "growing": lambda t, w, r: w * np.exp(5 * t / max(t[-1], 0.01)),
    "moving": lambda t, w, r: 3.0 * np.sin(t) + 0.01 * w,
    "ramp": lambda t, w, r: 100.0 * t,
    "step": lambda t, w, r: (t > t[len(t) // 2]).astype(float),
    "cauchy": lambda t, w, r: r.standard_cauchy(len(t)),
    "held values": lambda t, w, r: np.repeat(w[: len(t) // 10 + 1], 10)[: len(t)],
    "begins late": lambda t, w, r: np.where(np.arange(len(t)) < len(t) // 2, 0.0, w),
    "nearly empty": lambda t, w, r: np.where(r.random(len(t)) < 0.97, np.nan, w),
    "large offset": lambda t, w, r: 1e15 + 1e8 * w,
}


def finite_or_a_sentence(y):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            fit = jaxcal.noise.fit(y, 100.0)
        except jaxcal.JaxcalError:
            return
    tables = (fit.interval, fit.upper_limit, fit.significance, fit.longer_record, fit.covariance, fit.goodness, fit.noise)
    assert not any(np.isnan(leaf).any() for leaf in jax.tree.leaves(tables))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [2, 30, 500, 3000])
def test_the_answer_is_finite_or_a_sentence(kind, n):
    random = np.random.default_rng([n, len(kind)])
    finite_or_a_sentence(KINDS[kind](np.arange(n) / 100.0, random.standard_normal(n), random))


def test_a_record_of_which_a_filter_alone_is_left():
    random = np.random.default_rng([1, 172])
    random.uniform()
    finite_or_a_sentence(KINDS["growing"](np.arange(766) / 100.0, random.standard_normal(766), random))


@pytest.mark.parametrize(("n", "at"), [(200, [20]), (1024, [337]), (64, [38, 38, 12]), (308, [294, 294]), (1052, [570, 100, 570])])
def test_steps_without_noise(n, at):
    finite_or_a_sentence(1e-5 * (np.arange(n)[:, None] >= at))
