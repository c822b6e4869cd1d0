"""Terms that a model lacks: rates of false alarms, the change that a refit finds, and covariances that hold a hidden term."""

import numpy as np
import pytest

from jaxcal.fitting._missing import missing

TIME = np.linspace(-1, 1, 40)
LINE = np.stack([np.ones(40), TIME], axis=1)
TERMS = {"drift": TIME[:, None] ** 3, "pair": np.stack([TIME**2, np.abs(TIME)], axis=1), "line": TIME[:, None]}


def left(y):
    return y - LINE @ np.linalg.lstsq(LINE, y)[0]


@pytest.mark.parametrize("sigma", [None, 0.1])
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


def test_what_the_residuals_do_not_exclude_is_added_by_its_plausible_size():
    """A cubic of 0.05, half of the noise, hardly shows; of a term that the line reproduces nothing shows."""
    rng, inside = np.random.default_rng(1), []
    for _ in range(400):
        y = 0.1 * rng.normal(size=40) + rng.normal() * 0.05 * TIME**3
        found = {one.name: one for one in missing(left(y), -LINE, TERMS, 0.1)}
        error = np.sqrt(0.01 * np.linalg.inv(LINE.T @ LINE)[1, 1] + found["drift"].added(0.05)[1, 1])
        inside.append(abs(np.linalg.lstsq(LINE, y)[0][1]) < 1.96 * error)
    assert np.mean(inside) > 0.93
    np.testing.assert_allclose(found["line"].added(0.2), [[0, 0], [0, 0.04]], atol=1e-12)
    assert not found["line"].added().any()
