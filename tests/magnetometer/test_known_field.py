"""A field that is known, and one that contradicts the readings."""

import numpy as np
import pytest

from jaxcal.magnetometer import fit

from . import cases


def test_a_known_field_helps_half_a_sphere():
    """Errors of the readings and of the given field are drawn in each run; 40 runs determine a coverage of 95 % to 3.5 %."""
    size, with_field, without, off = np.linalg.det(cases.MILD.soft_iron) ** (1 / 3), [], [], []
    rng = np.random.default_rng(3)
    for seed in range(40):
        m = cases.readings(cases.MILD, cases.directions(60, seed, "hemisphere"), 0.05, seed)
        norm = size * np.exp(0.01 * rng.normal())
        found, plain = fit(m, model="symmetric", field=norm, field_error=0.01), fit(m, model="symmetric", field=norm)
        with_field.append(found.model.hard_iron - cases.MILD.hard_iron)
        without.append(plain.model.hard_iron - cases.MILD.hard_iron)
        off.append(with_field[-1] / found.estimate.select("hard_iron*").error)
        assert found.estimate.select("hard_iron*").error[2] < 0.8 * plain.estimate.select("hard_iron*").error[2]
    assert cases.rms(with_field) < 0.65 * cases.rms(without)
    assert np.mean(np.abs(off) < 1.96) > 0.9


def test_a_field_that_contradicts_the_readings_is_said():
    m = cases.paper_readings("all", 0.2, 0)
    plain = fit(m)
    size = np.linalg.det(np.linalg.inv(plain.model.soft_iron) / plain.field) ** (-1 / 3)
    wrong = fit(m, field=1.1 * size, field_error=0.01)
    assert wrong.verdict == "weak"
    assert "contradicts" in wrong.codes
    right = fit(m, field=1.01 * size, field_error=0.01)
    assert right.verdict == "good"
    assert right.field == pytest.approx(1.01 * size)
    # a tenth of its standard error
    np.testing.assert_allclose(right.model.hard_iron, plain.model.hard_iron, atol=0.002)
