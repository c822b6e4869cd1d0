"""Terms that a model lacks: rates of false alarms, the change that a refit finds, and covariances that hold a hidden term."""

import numpy as np
import pytest

from jaxcal.fitting._missing import missing

TIME = np.linspace(-1, 1, 40)
LINE = np.stack([np.ones(40), TIME], axis=1)
TERMS = {"drift": TIME[:, None] ** 3, "pair": np.stack([TIME**2, np.abs(TIME)], axis=1), "line": TIME[:, None]}


def left(y):
    return y - LINE @ np.linalg.lstsq(LINE, y)[0]


@pytest.mark.parametrize("sigma", [pytest.param(None, marks=pytest.mark.long), 0.1])
def test_a_term_is_seldom_seen_where_none_is_and_found_where_one_is(sigma):
    rng = np.random.default_rng(0)
    noise = 0.1 * rng.normal(size=(1000, 40))
    first = [missing(left(y), -LINE, TERMS, sigma)[0] for y in noise]
    assert np.mean([one.level < 0.05 for one in first]) == pytest.approx(0.04, abs=0.03)
    y = noise[0] + 0.5 * TIME**3
    best = missing(left(y), -LINE, TERMS, sigma)[0]
    assert best.name == "drift"
    assert best.shown
    refit = np.linalg.lstsq(np.concatenate([LINE, TERMS["drift"]], axis=1), y)[0]
    np.testing.assert_allclose(np.linalg.lstsq(LINE, y)[0] + best.shift, refit[:2], atol=1e-12)
    np.testing.assert_allclose(best.coefficient, refit[2:], atol=1e-12)


def test_the_noise_of_the_sensor_shows_a_term_that_few_readings_hide():
    """Seven readings with a term: beside their known noise it is over twice as probable as beside their own scatter."""
    few = np.s_[::6]
    rng, term = np.random.default_rng(1), {"drift": TERMS["drift"][few]}
    noise = 0.1 * rng.normal(size=(300, 7))
    odds = [[[missing(y, -LINE[few], term, least=least)[0].odds for least in (0.0, 0.1)] for y in noise + size * term["drift"][:, 0]]
            for size in (0.0, 0.8)]  # fmt: skip
    (none, known), (scattered, shown) = np.median(odds, axis=1)
    assert known < none < 1
    assert shown > 2 * scattered
