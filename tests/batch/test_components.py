"""Variance components and gauge studies."""

import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.batch import components, gauge

#: AIAG, Measurement Systems Analysis, 4th edition, 2010, gauge study of 10 parts (columns) by 3 appraisers in 3 trials (rows of each);
#: printed also in B. McNeese, Three Ways to Analyze a Gage R&R Study, BPI Consulting, 2015
AIAG = np.array(
    [
        [
            [0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36],
            [0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25],
            [0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31],
        ],
        [
            [0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68],
            [0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62],
            [0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50],
        ],
        [
            [0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49],
            [-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77],
            [-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16],
        ],
    ]
)


def test_the_example_of_the_aiag_manual():
    operator, _, part = (index.ravel() for index in np.indices(AIAG.shape))
    found = gauge(AIAG.ravel(), part, operator)
    assert found.pooled == ("part:operator",)
    printed = {"EV": 0.199933, "AV": 0.226838, "GRR": 0.302373, "PV": 1.042327, "%EV": 18.42, "%AV": 20.90, "%GRR": 27.86, "%PV": 96.04}
    reported = dict(zip(found.ratio_names, found.ratios, strict=True))
    for name, value in printed.items():
        assert reported[name] == pytest.approx(value, rel=3e-4), name
    assert int(reported["distinct categories"]) == 4
    # the manual's analysis of variance, with the interaction
    whole = gauge(AIAG.ravel(), part, operator, pool=1.0)
    order = [whole.names.index(name) for name in ("part", "operator", "part:operator", "repeatability")]
    np.testing.assert_allclose(whole.degrees_of_freedom[order], [9, 2, 18, 60])
    np.testing.assert_allclose(whole.mean_square[order], [9.81799, 1.58363, 0.01994, 0.04598], atol=6e-6)
    assert found.interval[found.names.index("part:operator"), 1] > 0.0  # although it was pooled, it may be present
    assert "AV" in found.summary()
    by_tolerance = gauge(AIAG.ravel(), part, operator, tolerance=6.0)
    assert by_tolerance.ratios[-1] == pytest.approx(0.302373, rel=3e-4)
    assert found.verdict == "good"


def test_two_operators_who_differ_are_a_weak_study():
    operator, _, part = (index.ravel() for index in np.indices(AIAG[:2].shape))
    few = gauge((AIAG[:2] + np.array([0.3, 0.0])[:, None, None]).ravel(), part, operator)
    assert few.verdict == "weak"
    (told,) = few.findings
    assert (told.code, told.facts["name"], told.facts["free"]) == ("open", "operator", 1)
    # if two operators agree, their number does not limit the result
    rng = np.random.default_rng(1)
    x = rng.normal(size=(1, 1, 10)) + 0.1 * rng.normal(size=(2, 3, 10))
    assert gauge((x - x.mean(axis=(1, 2), keepdims=True)).ravel(), part, operator).verdict == "good"


def test_nested_levels_of_a_balanced_study_are_those_of_the_textbook():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(6, 1, 1)) + 0.5 * rng.normal(size=(6, 4, 1)) + 0.3 * rng.normal(size=(6, 4, 3))
    device, recording, _ = (index.ravel() for index in np.indices(x.shape))
    found = components(x.ravel(), {"device": device, "recording": recording})
    inner, middle, outer = x.var(axis=2, ddof=1).mean(), x.mean(axis=2).var(axis=1, ddof=1).mean(), x.mean(axis=(1, 2)).var(ddof=1)
    np.testing.assert_allclose(found.variance, [outer - middle / 4, middle - inner / 3, inner])
    # the interval of the rest agrees with the classical one to the error of its simulations
    np.testing.assert_allclose(found.interval[2] / inner, 48 / np.array([69.02, 30.75]), rtol=0.01)


@pytest.mark.long
@pytest.mark.parametrize("deviations", [(1.0, 0.25, 0.0, 0.2), (1.0, 0.25, 0.2, 0.2)])
def test_gauge_studies_find_their_components_and_intervals_hold(deviations):
    part, operator, _ = (index.ravel() for index in np.indices((10, 3, 3)))
    rng, ratio, held, truth = np.random.default_rng(1), [], [], np.square(deviations)
    for _ in range(400):
        effects = rng.standard_normal(10)[part], rng.standard_normal(3)[operator], rng.standard_normal((10, 3))[part, operator]
        values = sum(s * one for s, one in zip(deviations, (*effects, rng.standard_normal(90)), strict=True))
        found = gauge(values, part, operator)
        order = [found.names.index(name) for name in ("part", "operator", "part:operator", "repeatability")]
        ratio.append(found.variance[order])
        held.append((found.interval[order, 0] <= truth) & (truth <= found.interval[order, 1]))
    there = truth > 0.0
    # the variance of three operators scatters by its own size, so that the mean of 400 has an error of 5 %
    np.testing.assert_array_less(np.abs(np.mean(ratio, axis=0)[there] / truth[there] - 1.0), np.array([0.08, 0.16, 0.08, 0.05])[there])
    np.testing.assert_array_less(np.abs(np.mean(held, axis=0)[there] - 0.95), 0.033)
    assert np.mean(held, axis=0)[~there].min(initial=1.0) > 0.93


@pytest.mark.parametrize("seed", range(20))
def test_rounding_is_not_a_result(seed):
    rng = np.random.default_rng(seed)
    part, operator, again = (index.ravel() for index in np.indices((7, 3, 2)))
    exact = 10.0 ** rng.uniform(-6, 6) * (rng.normal() + rng.normal(size=7)[part] + rng.normal(size=3)[operator])
    with pytest.raises(DataError, match="equal to rounding"):
        gauge(exact, part, operator)
    # a scatter of 1e-10 of the mean keeps its digits
    noise = rng.normal(size=42)
    study = components(9.81 + 1e-9 * noise, {"part": part, "recording": again})
    np.testing.assert_allclose(study.mean_square, 1e-18 * components(noise, {"part": part, "recording": again}).mean_square, rtol=1e-5)


def test_messages():
    part, operator = np.repeat(np.arange(4), 3), np.tile(np.arange(3), 4)
    with pytest.raises(DataError, match="none is left for the repeatability; measure each group twice"):
        components(np.random.default_rng(0).normal(size=12), {"part": np.arange(12)})
    with pytest.raises(DataError, match="level 'part': 12 values and 2 names"):
        gauge(np.zeros(12), [1, 2], operator)
    with pytest.raises(DataError, match="equal to rounding"):
        components(part.astype(float), {"part": part})
    with pytest.raises(DataError, match="level 'same' cannot be told from those before it"):
        components(np.random.default_rng(0).normal(size=12), {"part": part, "same": np.zeros(12)})
    with pytest.raises(DataError, match="there are no levels"):
        components(np.zeros(3), {})
    with pytest.raises(DataError, match="crossed: there is no level day"):
        components(np.zeros(12), {"part": part}, crossed=("day",))
    with pytest.raises(DataError, match="finite numbers"):
        components([np.nan, 1.0], {"part": [0, 1]})
    with pytest.raises(DataError, match="tolerance must be positive"):
        gauge(np.zeros(12), part, operator, tolerance=0.0)
