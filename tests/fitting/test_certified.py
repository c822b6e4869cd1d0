"""Nonlinear regression problems of the NIST Statistical Reference Datasets, from both published starts."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal.fitting import covariance, identifiability, solve


def misra1a(b, data):
    x, y = data
    return b[0] * (1 - jnp.exp(-b[1] * x)) - y


def rat43(b, data):
    x, y = data
    return b[0] / (1 + jnp.exp(b[1] - b[2] * x)) ** (1 / b[3]) - y


def mgh09(b, data):
    x, y = data
    return b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]) - y


def mgh10(b, data):
    x, y = data
    return b[0] * jnp.exp(b[1] / (x + b[2])) - y


# residuals, x, y, starts, certified parameters, their standard deviations, residual sum of squares
CERTIFIED = {
    "Misra1a": (
        misra1a,
        [77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0],
        [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78],
        [(500, 1e-4), (250, 5e-4)],
        [2.3894212918e02, 5.5015643181e-04], [2.7070075241e00, 7.2668688436e-06], 1.2455138894e-01,
    ),
    "BoxBOD": (
        misra1a,
        [1, 2, 3, 5, 7, 10],
        [109, 149, 149, 191, 213, 224],
        [(1, 1), (100, 0.75)],
        [2.1380940889e02, 5.4723748542e-01], [1.2354515176e01, 1.0455993237e-01], 1.1680088766e03,
    ),
    "Rat43": (
        rat43,
        range(1, 16),
        [16.08, 33.83, 65.80, 97.20, 191.55, 326.20, 386.87, 520.53, 590.03, 651.92, 724.93, 699.56, 689.96, 637.56, 717.41],
        [(100, 10, 1, 1), (700, 5, 0.75, 1.3)],
        [6.9964151270e02, 5.2771253025e00, 7.5962938329e-01, 1.2792483859e00],
        [1.6302297817e01, 2.0828735829e00, 1.9566123451e-01, 6.8761936385e-01],
        8.7864049080e03,
    ),
    "MGH09": (
        mgh09,
        [4, 2, 1, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625],
        [0.1957, 0.1947, 0.1735, 0.16, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246],
        [(25, 39, 41.5, 39), (0.25, 0.39, 0.415, 0.39)],
        [1.9280693458e-01, 1.9128232873e-01, 1.2305650693e-01, 1.3606233068e-01],
        [1.1435312227e-02, 1.9633220911e-01, 8.0842031232e-02, 9.0025542308e-02],
        3.0750560385e-04,
    ),
    "MGH10": (
        mgh10,
        range(50, 130, 5),
        [34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744, 8261, 7030, 6005, 5147, 4427, 3820, 3307, 2872],
        [(0.02, 4000, 250)],  # `solve` does not converge from the far start
        [5.6096364710e-03, 6.1813463463e03, 3.4522363462e02], [1.5687892471e-04, 2.3309021107e01, 7.8486103508e-01], 8.7945855171e01,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CERTIFIED)
def test_certified_values(name):
    residuals, x, y, starts, parameters, errors, sum_of_squares = CERTIFIED[name]
    data = (np.array(x, dtype=float), np.array(y, dtype=float))
    for start in starts:
        fit = solve(residuals, np.array(start, dtype=float), data, max_steps=2000).checked()
        np.testing.assert_allclose(fit.parameters, parameters, rtol=1e-7)
        np.testing.assert_allclose(np.sqrt(np.diag(covariance(fit, scaled=True))), errors, rtol=1e-7)
        np.testing.assert_allclose(2 * fit.cost, sum_of_squares, rtol=1e-10)
        assert identifiability(fit).rank == len(parameters)
