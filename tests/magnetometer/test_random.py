"""Arbitrary readings give a verdict and no exception. `benchmarks/magnetometer.py --only random` has thousands of logs."""

import importlib.util
import pathlib
import warnings

import pytest

from jaxcal.magnetometer import fit

_PLACE = pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "_faults.py"
_SPEC = importlib.util.spec_from_file_location("faults", _PLACE)
faults = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(faults)

#: logs with tilts of 10 to 30 degrees, for which the largest model diverges until rounding leaves no ellipsoid
AWAY = (68, 234, 295, 342, 480)


@pytest.mark.parametrize("seed", AWAY)
def test_an_ellipsoid_that_runs_off_is_no_exception(seed):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = fit(faults.random_log(seed, (10.0, 30.0), (0.03, 0.1), (100, 1000)))
    assert found.verdict in ("weak", "refused")


def test_random_logs_have_a_verdict():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        words = {fit(faults.random_log(seed)).verdict for seed in range(12)}
    assert {"good", "refused"} <= words <= {"good", "weak", "refused"}
