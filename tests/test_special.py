"""Chi-square, Fisher's F and Student's t against SciPy."""

import numpy as np
import pytest
import scipy.special

from jaxcal._special import chi_square_tail, f_tail, student_quantile


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 7, 20, 51, 400, 2001, 20_000])
def test_tail_of_chi_square(freedom):
    value = freedom * np.array([0.0, 1e-6, 0.01, 0.3, 0.9, 1.0, 1.1, 1.5, 3.0, 20.0])
    np.testing.assert_allclose(chi_square_tail(value, freedom), scipy.special.chdtrc(freedom, value), rtol=1e-10, atol=1e-300)
    assert chi_square_tail(np.inf, freedom) == 0
    assert np.isnan(chi_square_tail(np.nan, freedom))


@pytest.mark.parametrize("probability", [0.6, 0.9, 0.975, 0.9995])
def test_quantile_of_student(probability):
    freedom = np.array([0.5, 1, 1.5, 2, 3, 4.2, 5, 9, 17.3, 30, 100, 333.3, 499.9, 500, 501, 1e3, 1e4, 1e6, 1e12])
    np.testing.assert_allclose(student_quantile(freedom, probability), scipy.special.stdtrit(freedom, probability), rtol=1e-10)
    np.testing.assert_allclose(student_quantile(np.inf, probability), scipy.special.ndtri(probability), rtol=1e-13)
    assert np.isnan(student_quantile(0.0, probability))


@pytest.mark.parametrize("above", [1, 2, 3, 7, 40])
@pytest.mark.parametrize("below", [1, 2, 6, 45, 3000])
def test_tail_of_f(above, below):
    ratio = np.array([0.0, 1e-9, 0.01, 0.3, 0.9, 1.0, 1.1, 3.0, 20.0, 1e6])
    least, most = above * ratio / (below + above * ratio), below / (below + above * ratio)
    # scipy 1.16's fdtrc is off by 2e-9 beside one
    expected = np.where(ratio < 1, scipy.special.betaincc(above / 2, below / 2, least), scipy.special.betainc(below / 2, above / 2, most))
    np.testing.assert_allclose(f_tail(ratio, above, below), expected, rtol=1e-10, atol=1e-300)
    assert np.isnan(f_tail(np.nan, above, below))
