"""Logs with errors that the model does not contain: the error stated, the verdict, and what is named. `benchmarks/` has more runs."""

import importlib.util
import json
import pathlib

import numpy as np
import pytest

from jaxcal.magnetometer import fit, heading_uncertainty

_PLACE = pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "_faults.py"
_SPEC = importlib.util.spec_from_file_location("faults", _PLACE)
faults = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(faults)


@pytest.fixture(scope="module")
def tries():
    return {case: faults.tried(fit, case, 5) for case in faults.CASES}


def test_the_verdict_is_that_of_the_true_error(tries):
    good, true, *_ = np.concatenate(list(tries.values())).T
    assert np.mean(good[true < 1.0]) >= 0.8
    assert np.mean(true[good > 0] > 1.0) <= 0.07
    assert np.mean(true[good > 0] > 1.5) <= 0.02


def test_the_stated_error_is_the_true_one(tries):
    ratio = np.concatenate([rows[:, 2] for rows in tries.values()])
    assert 0.7 < np.median(ratio) < 1.25
    assert np.sqrt(np.mean(ratio**2)) < 1.3
    assert np.mean(ratio < 2.1) > 0.93


def test_intervals_hold_the_truth(tries):
    assert np.mean([rows[:, 4].mean() for rows in tries.values()]) > 0.92


def test_what_acts_alike_in_every_part_is_named(tries):
    for (name, size), code in faults.CASES.items():
        if code in ("averaged", "bent", "follows"):
            assert np.mean(tries[name, size][:, 3]) > 0.6, name


def test_white_noise_is_called_white():
    rows = faults.tried(fit, ("white", 0.01), 40)
    assert np.mean(rows[:, 0]) >= 0.95
    assert 0.88 < np.mean(rows[:, 4]) <= 1.0  # 120 intervals of 95 %, three from each run
    quiet = [fit(faults.simulate(("white", 0.01), seed)[0]) for seed in range(20)]
    assert np.mean([found.codes <= {"dip_assumed", "unseen_axes"} for found in quiet]) >= 0.9


def test_a_cause_is_a_finding_with_its_cost():
    m, _ = faults.simulate(("quadratic", 0.02), 0)
    found = fit(m)
    cause = next(one for one in found.findings if one.code == "bent")
    # all figures of the error contain it
    rms = np.sqrt(np.mean(heading_uncertainty(found, np.arange(24) * np.pi / 12) ** 2))
    assert rms == pytest.approx(found.heading_error[0], rel=1e-6)
    assert found.heading_error[0] >= cause.cost > 3 * fit(faults.simulate(("white", 0.01), 0)[0]).heading_error[0]


def test_parts_of_a_log_give_student_intervals():
    m, _ = faults.simulate(("AR(1)", 0.9), 0)
    found = fit(m)
    assert set(found.estimate.freedom) == {5.0}
    # Student's t with five degrees of freedom
    assert found.estimate["hard_iron[0]"].half == pytest.approx(2.5706 * found.estimate.error[0], rel=1e-4)
    assert "correlated" in {one["code"] for one in found.to_dict()["findings"]}


def test_the_verdict_does_not_depend_on_the_names_of_the_axes():
    for case in (("AR(1)", 0.9), ("field", 0.05)):
        m, _ = faults.simulate(case, 1)
        found = [fit(m[:, order]) for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1])]
        assert len({one.verdict for one in found}) == 1
        np.testing.assert_allclose([one.heading_error for one in found], [found[0].heading_error] * 3, rtol=1e-3)


SPOILT = {
    "one spike": lambda m, rng: _moved(m, 1, 5.0, rng), "1 % spikes": lambda m, rng: _moved(m, 6, 30.0, rng),
    "3 % spikes": lambda m, rng: _moved(m, 18, 300.0, rng), "zeros": lambda m, rng: np.where(rng.random((len(m), 1)) < 0.03, 0.0, m),
    "held": lambda m, rng: np.repeat(m, 5, axis=0),
}  # fmt: skip


def _moved(m, count, size, rng):
    m = m.copy()
    m[rng.choice(len(m), count, replace=False)] += size * rng.normal(size=(count, 3))
    return m


@pytest.mark.parametrize("kind", SPOILT)
def test_readings_that_are_none_of_the_field_do_not_matter(kind):
    off, level = [], np.stack([np.arange(24) * np.pi / 12, np.zeros(24), np.zeros(24)], axis=1)
    for seed in range(10):
        m, _ = faults.simulate(("white", 0.01), seed)
        clean, spoilt = fit(m), fit(SPOILT[kind](m, np.random.default_rng(seed)))
        assert spoilt.verdict == "good"
        off.append(np.rad2deg(_apart(clean, spoilt, level)))
    assert np.mean(np.array(off) < 0.1) >= 0.9


def _apart(one, two, level):
    """Root mean square difference of level headings, rad."""
    y = two.model.correct(one.model.measure(float(one.field) * faults.level_field()))
    return np.sqrt(np.mean(np.angle(np.exp(1j * (np.arctan2(-y[:, 1], y[:, 0]) - level[:, 0]))) ** 2))


def tumbles(folder):
    """Real logs in the order of time."""
    for path in sorted(folder.glob("betaflight/*_tumble.json")):
        yield np.array([[s[axis] for axis in "xyz"] for s in json.loads(path.read_text())["samples"]], dtype=float)
    yield np.loadtxt(folder / "ellipsoid_fit_python" / "mag_out.txt")
    yield np.loadtxt(folder / "jremington" / "mag3_raw.csv", delimiter=",")
    yield np.loadtxt(next(folder.glob("pichim/*.txt")), delimiter=",")[:, :3]


def test_halves_of_real_logs_differ_as_stated(reference):
    ratio, level = [], np.stack([np.arange(24) * np.pi / 12, np.zeros(24), np.zeros(24)], axis=1)
    for m in tumbles(reference / "data" / "magnetometer"):
        found = fit(m)
        halves = [fit(half) for half in np.array_split(m, 2)]
        ratio.append(_apart(*halves, level) / 2 / found.heading_error[0])
        assert np.rad2deg(found.heading_error[0]) < 1.2
    assert 0.6 < np.median(ratio) < 1.5
