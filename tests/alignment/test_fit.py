"""The joint fit against the Cramer-Rao bound, parameters that the data do not determine, the bound itself, and the plan of a test."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from jaxcal.alignment import Positions, Readings, Sensor, Turntable, crlb, fit, plan, residuals, simulate
from jaxcal.alignment._model import NAMES
from jaxcal.noise import Noise

from . import cases
from .cases import ARW, DEG, VRW, apart, outcome

SEVEN = NAMES[:7]
PAPER, LATITUDE = np.array([50.0, 30.0, 88.0]) * DEG, 35 * DEG
X4 = [("x", 0), ("x", 90), ("x", 180), ("x", 270)]
Z4, MZ4 = ([(mounting, angle) for _, angle in X4] for mounting in ("z", "-z"))
PRIORS = {"s_a": 1e-4, "s_g": 1e-4}
FIVE = ("phi", "theta", "psi", "b_a", "b_g")


def test_bounds_of_the_reference_file(reference):
    for case in cases.vectors(reference)["crlb"]:
        dwell = np.array(case["dwell"])
        start = np.array(case["time"]) - dwell / 2 if "time" in case else None
        bound = crlb(
            cases.positions(case["positions"], dwell, start), np.array(case["attitude_deg"]) * DEG, case["latitude_deg"] * DEG,
            accel_noise=case["velocity_random_walk"], gyro_noise=case["angle_random_walk"], free=case["free"], priors=case["prior"],
        )  # fmt: skip
        for name, sigma in case["sigma"].items():
            assert bound.std[name] == pytest.approx(sigma, rel=1e-6), case["name"]
        assert bound.azimuth_std / DEG == pytest.approx(case["azimuth_sigma_deg"], rel=1e-6)


def test_ranks_and_what_is_confounded(reference):
    five = (*NAMES[:4], "b_g")
    sets = {
        "angles_biases": five, "plus_scales": SEVEN, "plus_misalignments": NAMES[:11], "angles_biases_latitude": (*five, "latitude"),
        "gyro_scale_latitude": (*five, "s_g", "latitude"), "plus_scales_latitude": (*SEVEN, "latitude"),
        "everything_latitude": (*NAMES[:11], "latitude"),
    }  # fmt: skip
    rows = {
        "x_0_180": X4[::2], "x_0_90_180": X4[:3], "x4": X4, "x8": [("x", a) for a in range(0, 360, 45)], "x4_z": [*X4, ("z", 0)],
        "x4_z_mz": [*X4, ("z", 0), ("-z", 0)], "x4_z4": X4 + Z4, "x4_z4_mz4": X4 + Z4 + MZ4,
    }  # fmt: skip
    counted = 0
    for case in cases.vectors(reference)["rank"]:
        attitude = PAPER if case["attitude"] == "tilted" else np.array([0.0, 0.0, 88.0]) * DEG
        for name, expected in case.items():
            if isinstance(expected, dict):
                bound = crlb(cases.positions(rows[case["positions"]]), attitude, LATITUDE, accel_noise=VRW, gyro_noise=ARW, free=sets[name])
                assert int(bound.rank) == expected["rank"], (case["positions"], name)
                assert set(bound.unobservable) == set(expected["confounded"]), (case["positions"], name)
                counted += 1
    assert counted == 112


def test_rules_of_thumb():
    total, h = 240.0, np.cos(LATITUDE)
    unit = ARW / (7.292115e-5 * h)
    level = np.array([0.0, 0.0, 88.0]) * DEG
    known = {"accel_noise": VRW, "gyro_noise": ARW, "free": ("psi", "b_g")}
    for count in (3, 4, 8):
        places = Positions(2 * np.pi * np.arange(count) / count, dwell=total / count)
        assert crlb(places, level, LATITUDE, **known).azimuth_std == pytest.approx(unit * np.sqrt(2 / total), rel=1e-9)
    pair = lambda angle: Positions([angle, angle + np.pi], dwell=total / 2)  # noqa: E731
    best = np.pi / 2 - level[2]  # of a level table: the sensitive axis points east
    assert crlb(pair(best), level, LATITUDE, **known).azimuth_std == pytest.approx(unit / np.sqrt(total), rel=1e-9)
    # table angles that are off by 10 degrees increase the standard deviation by 1.5 %
    off = crlb(pair(best + 10 * DEG), level, LATITUDE, **known).azimuth_std
    assert off == pytest.approx(unit / np.sqrt(total) / np.cos(10 * DEG), rel=1e-9)
    worst = crlb(pair(best + np.pi / 2), level, LATITUDE, **known)
    assert worst.undetermined == ("psi",)
    assert np.isinf(worst.azimuth_std)


#: all layouts have the same mountings and leave readings out, so that they share one compiled program
MOUNTINGS = ["x"] * 8 + ["z", "-z"]
LAYOUTS = {
    # angles of the eight x positions, dwells (0: not measured), free parameters, priors
    "x4": ([0, 90, 180, 270] * 2, [60] * 4 + [0] * 6, SEVEN, PRIORS),
    "x4 + z + -z": ([0, 90, 180, 270] * 2, [40] * 4 + [0] * 4 + [40] * 2, SEVEN, {}),
    "unequal dwells": ([0, 90, 180, 270] * 2, [15, 100, 45, 80] + [0] * 6, SEVEN, PRIORS),
    "drift free, mirrored": ([0, 90, 180, 270, 270, 180, 90, 0], [30] * 8 + [0] * 2, (*SEVEN, "b_g_rate"), PRIORS),
}


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.long
def test_the_fit_is_at_the_bound(name):
    angles, dwell, free, priors = LAYOUTS[name]
    runs, measured = 1000, np.array(dwell) > 0
    places = Positions(np.array([*angles, 0, 0]) * DEG, MOUNTINGS, np.where(measured, dwell, 1.0))
    accel, gyro = Sensor(bias=1e-3, white=VRW), Sensor(bias=5e-8, white=ARW)

    # the true scale errors are drawn from their priors, so that covariance and chi-square are valid on average over the runs
    spread = 1e-4 if priors else 0.0

    def one(key):
        key, first, second = jax.random.split(key, 3)
        scaled = (Sensor(spread * jax.random.normal(k), (0.0, 0.0), s.bias, white=s.white) for k, s in ((first, accel), (second, gyro)))
        readings = simulate(places, PAPER, LATITUDE, **dict(zip(("accel", "gyro"), scaled, strict=True)), seed=key)
        a, w = (jnp.where(measured, values, jnp.nan) for values in (readings.accel, readings.gyro))
        found = fit(Readings(places, a, w, accel_noise=VRW, gyro_noise=ARW), LATITUDE, free=free, priors=priors)
        return found.estimate.values, found.covariance, found.p_value, found.outcome

    values, covariance, p_value, verdict = jax.vmap(one)(jax.random.split(jax.random.key(11), runs))
    kept = list(np.flatnonzero(measured))
    alone = Positions(np.array([*angles, 0, 0])[kept] * DEG, [MOUNTINGS[i] for i in kept], np.array(dwell)[kept], places.start[kept])
    bound = crlb(alone, PAPER, LATITUDE, accel_noise=VRW, gyro_noise=ARW, free=free, priors=priors)
    rmse = np.sqrt(np.mean(apart(values[:, 2], PAPER[2]) ** 2))
    # an rmse over 1,000 runs has a standard error of 2.2 %
    assert 0.9 < rmse / bound.azimuth_std < 1.1
    assert np.all(np.asarray(verdict) == 0) or np.mean(np.asarray(p_value) < 1e-3) < 5e-3
    np.testing.assert_allclose(np.median(covariance[:, 2, 2]) ** 0.5, bound.azimuth_std, rtol=0.02)
    # the normalised squared error of the three angles has a chi-square distribution with three degrees of freedom
    error = np.asarray(values)[:, :3] - PAPER[None, :]
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(np.asarray(covariance)[:, :3, :3]), error)
    assert scipy.stats.kstest(squared, "chi2", (3,)).pvalue > 1e-3
    assert np.mean(squared) == pytest.approx(3, abs=4 * np.sqrt(6 / runs))
    assert scipy.stats.kstest(p_value, "uniform").pvalue > 1e-3


def readings_at(rows, attitude=PAPER, latitude=LATITUDE, dwell=60.0, **errors):
    noise = {"accel_noise": VRW, "gyro_noise": ARW}
    made = simulate(cases.positions(rows, dwell), attitude, latitude, **errors)
    return Readings(made.positions, made.accel, made.gyro, **noise)


def test_parameters_that_nothing_determines_are_named_and_have_no_number():
    found = fit(readings_at(X4), LATITUDE, free=SEVEN)
    assert "unobservable" in found.codes
    assert set(found.unobservable) == {"phi", "theta", "psi", "s_a", "s_g"}
    assert found.psi is None
    assert found.phi is None
    assert np.isinf(found.std["psi"])
    assert not np.isnan(found.covariance).any()
    level = fit(readings_at(X4, np.array([0.0, 0.0, 88.0]) * DEG), LATITUDE, free=SEVEN)
    assert level.unobservable == ("s_a",)
    assert apart(level.psi, 88 * DEG) < 1e-9
    assert level.parameters["s_a"] is None


def test_a_prior_gives_a_number_and_says_that_it_did():
    found = fit(readings_at(X4), LATITUDE, free=SEVEN, priors=PRIORS)
    assert outcome(found) == "ok"
    assert found.undetermined == ()
    assert found.std["s_a"] == pytest.approx(1e-4, rel=1e-3)
    assert next(one.facts["names"] for one in found.findings if one.code == "prior_alone").startswith("s_a")
    assert apart(found.psi, PAPER[2]) < 1e-9


def test_the_mirrored_attitude_is_named_for_readings_of_the_table_alone():
    found, places = fit(readings_at(X4), LATITUDE), cases.positions(X4)
    assert "mirrored" in found.codes
    again = simulate(places, np.array([np.pi - PAPER[0], PAPER[1], -PAPER[2]]), LATITUDE)
    np.testing.assert_allclose(again.gyro, simulate(places, PAPER, LATITUDE).gyro, atol=1e-17)
    assert "mirrored" not in fit(readings_at([*X4, ("z", 0)]), LATITUDE).codes
    upside_down = np.array([130.0, 30.0, -88.0]) * DEG
    assert apart(fit(readings_at([*X4, ("z", 0)], upside_down), LATITUDE).psi, -88 * DEG) < 1e-9
    assert apart(fit(readings_at(X4, upside_down), LATITUDE, start={"phi": 2.3}).psi, -88 * DEG) < 1e-9


def test_latitude():
    found = fit(readings_at([*X4, ("z", 0)]))
    assert found.latitude == pytest.approx(LATITUDE, abs=1e-9)
    table = fit(readings_at(X4), hemisphere="north")
    assert table.latitude == pytest.approx(LATITUDE, abs=1e-9) or "undecided" in table.codes
    for options in ({"free": (*FIVE, "s_g")}, {}):
        rows = X4 if options else X4[::2]
        assert fit(readings_at(rows), **options).latitude is None
    # without the hemisphere two latitudes and azimuths fit: both are withheld, what they share is given, and an option decides
    either = fit(readings_at(X4, np.array([1.0, 2.0, 40.0]) * DEG))
    assert [either.latitude, either.psi, either.parameters["b_g"] is None] == [None, None, False]
    (told,) = (one for one in either.findings if one.code == "undecided")
    assert "--hemisphere" in told.spelt("terminal")


def test_two_azimuths_that_fit_are_not_decided_in_silence():
    # with a known level and one opposed pair, the azimuth and its mirror image about the meridian both fit
    readings = readings_at(X4[::2], np.array([0.0, 0.0, 40.0]) * DEG)
    options = {"free": ("psi", "b_g"), "start": {"phi": 0.0, "theta": 0.0}}
    found = fit(readings, LATITUDE, **options)
    assert "undecided" in found.codes
    assert found.psi is None
    assert abs(np.rad2deg(found.estimate.values[2])) == pytest.approx(40, abs=1.1)
    assert fit(readings, LATITUDE, hint=30 * DEG, **options).psi == pytest.approx(40 * DEG, abs=1e-9)


def test_a_misfit_is_told():
    readings = readings_at([*X4, ("x", 45), ("x", 135)])
    gyro = readings.gyro.copy()
    gyro[1] += 10 * ARW / np.sqrt(60)
    found = fit(Readings(readings.positions, readings.accel, gyro, accel_noise=VRW, gyro_noise=ARW), LATITUDE)
    assert "misfit" in found.codes
    assert found.p_value < 1e-3


def test_noise_from_the_residuals():
    rows = [("x", a) for a in range(0, 360, 36)]
    errors = {"accel": Sensor(white=VRW), "gyro": Sensor(white=ARW)}
    made = simulate(cases.positions(rows, 24.0), PAPER, LATITUDE, seed=3, **errors)
    found = fit(Readings(made.positions, made.accel, made.gyro), LATITUDE)
    # six redundant readings of the gyro determine the noise to 29 %
    assert found.azimuth_std == pytest.approx(fit(made, LATITUDE).azimuth_std, rel=0.6)
    assert found.p_value is None
    assert "noise_from_residuals" in found.codes


def test_random_walk_of_the_bias_widens_the_azimuth_as_generalised_least_squares_says():
    """The bound agrees with generalised least squares in NumPy; the level is known, psi and the bias at the start are unknown."""
    walk, dwell = 5e-8, 30.0
    angles = np.array([0, 90, 180, 270, 270, 180, 90, 0]) * DEG
    places = Positions(angles, dwell=dwell)
    start = dwell * np.arange(8)
    covariance = walk**2 * (np.minimum.outer(start, start) + np.where(np.eye(8) > 0, dwell / 3, dwell / 2)) + np.eye(8) * ARW**2 / dwell
    slope = 7.292115e-5 * np.cos(LATITUDE) * -np.sin(angles + 88 * DEG)
    rows = np.stack([slope, np.ones(8)], axis=1)
    expected = np.sqrt(np.linalg.inv(rows.T @ np.linalg.solve(covariance, rows))[0, 0])
    level = np.array([0.0, 0.0, 88.0]) * DEG
    noise = Sensor(white=ARW, walk=walk)
    bound = crlb(places, level, LATITUDE, accel_noise=VRW, gyro_noise=noise, free=("psi", "b_g"))
    assert bound.azimuth_std == pytest.approx(expected, rel=1e-9)
    assert bound.azimuth_std > 1.05 * crlb(places, level, LATITUDE, accel_noise=VRW, gyro_noise=ARW, free=("psi", "b_g")).azimuth_std
    # the noise of `simulate` has the same covariance, except that the walk is relative to its mean over the test
    away = np.eye(8) - 1 / 8
    covariance = np.eye(8) * ARW**2 / dwell + away @ (covariance - np.eye(8) * ARW**2 / dwell) @ away
    keys = jax.random.split(jax.random.key(0), 4000)
    noisy = jax.vmap(lambda key: simulate(places, jnp.asarray(level), LATITUDE, gyro=noise, seed=key).gyro)(keys)
    sample = np.cov(np.asarray(noisy).T)
    np.testing.assert_allclose(np.diag(sample), np.diag(covariance), rtol=4 * np.sqrt(2 / 4000))
    size = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert np.max(np.abs(sample - covariance) / size) < 5 / np.sqrt(4000)


def test_plan_reaches_the_listed_optima(reference, refuses):
    with refuses("too_short"):
        plan(0.0, LATITUDE, accel_noise=VRW, gyro_noise=ARW)
    for case in cases.vectors(reference)["design"][::3]:
        found = plan(
            240.0, case["latitude_deg"] * DEG, attitude=np.array(case["attitude_deg"]) * DEG, accel_noise=VRW, gyro_noise=ARW,
            free=SEVEN, priors={"s_a": 1e-4, "s_g": case["gyro_scale_prior"]},
        )  # fmt: skip
        assert found.criterion / DEG == pytest.approx(case["optimum_sigma_deg"], rel=1e-3)
        assert float(np.sum(found.positions.dwell)) == pytest.approx(240.0)
        again = crlb(
            found.positions, np.array(case["attitude_deg"]) * DEG, LATITUDE, accel_noise=VRW, gyro_noise=ARW, free=SEVEN,
            priors={"s_a": 1e-4, "s_g": case["gyro_scale_prior"]},
        )  # fmt: skip
        assert again.azimuth_std == pytest.approx(found.criterion, rel=1e-6)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"free": ("phi", "yaw")}, "unknown_name"), ({"priors": {"s_a": 0.0}}, "prior"), ({"priors": {"psi": 0.1}}, "prior"),
        ({"hemisphere": "up"}, "hemisphere"), ({"gravity": 1.0}, "gravity"), ({"latitude": 35.0}, "latitude"),
    ],
)  # fmt: skip
def test_calls_that_are_wrong_are_refused(refuses, change, code):
    with refuses(code):
        fit(readings_at(X4), **({"latitude": LATITUDE} | change))


@pytest.mark.long
def test_the_azimuth_responds_to_everything_given_as_finite_differences_say():
    """The arguments include fixed parameters, priors, gravity, table angles and noise."""
    rows = [*X4, ("z", 0)]
    base = readings_at(rows, np.array([12.0, -11.0, 40.0]) * DEG)
    rng = np.random.default_rng(0)
    #: argument -> step in the unit of that argument
    steps = {
        "latitude": 1e-4, "gravity": 1e-3, "gyro": 1e-8 * rng.normal(size=5), "accel": 1e-4 * rng.normal(size=5),
        "angle": 1e-4 * rng.normal(size=5), "s_g": 1e-4, "s_a": 1e-4, "ma_g_xy": 1e-4, "prior": 1e-4, "deviation": 5e-7,
        "dwell": 0.1 * rng.normal(size=5), "accel_noise": 1e-2, "gyro_noise": 1e-2, "walk": 1e-2, "flicker": 1e-2, "time": 1e-2,
        "angle_std": 1e-2,
    }  # fmt: skip

    def psi(change):
        error = 1e-5 * (1 + change["angle_std"])
        places = Positions(base.positions.angle + change["angle"], base.positions.mounting, 60.0 + change["dwell"], angle_std=error)
        # the readings get errors, so that weights and priors matter
        accel, gyro = base.accel + 1e-4 * np.array([1.0, -2.0, 0.5, 1.0, 0.0]), base.gyro + 1e-7 * np.array([0.0, 1.0, -1.0, 2.0, 1.0])
        process = (1e-9, 30.0 * (1 + change["time"]))
        noise = Noise(
            N=ARW * (1 + change["gyro_noise"]), K=ARW / 100 * (1 + change["walk"]), B=1e-7 * (1 + change["flicker"]), markov=(process,)
        )
        given = {"accel_noise": VRW * (1 + change["accel_noise"]), "gyro_noise": noise}
        readings = Readings(places, accel + change["accel"], gyro + change["gyro"], **given)
        held = {"s_g": 1e-4 + change["s_g"], "s_a": 1e-4 + change["s_a"], "ma_g_xy": 1e-4 + change["ma_g_xy"]}
        prior = {"b_a": (1e-3 + change["prior"], 1e-4 + change["deviation"])}
        options = {"free": FIVE, "start": held, "priors": prior, "gravity": 9.80665 + change["gravity"]}
        return fit(readings, LATITUDE + change["latitude"], **options).estimate.values[2]

    none = jax.tree.map(np.zeros_like, steps)
    slopes = jax.jit(jax.grad(psi))(jax.tree.map(jnp.asarray, none))
    for name, step in steps.items():
        up, down = (psi(none | {name: sign * step}) for sign in (0.5, -0.5))
        # a fit stops within 1e-6 standard deviations (2e-9 rad), which is not small against the effect of the weights
        assert float(np.sum(slopes[name] * step)) == pytest.approx(up - down, rel=1e-3 if np.abs(up - down) < 1e-7 else 1e-4), name
    assert abs(float(slopes["latitude"])) > 0.01


class Squared(Turntable):
    """A user-defined model with a term of the accelerometer that is quadratic in its own reading."""

    k_a: Any = 0.0

    def measure(self, positions, **conditions):
        accel, gyro = super().measure(positions, **conditions)
        return accel + self.k_a * accel**2, gyro


def test_a_model_with_one_more_parameter_is_fitted_and_reported(refuses):
    places = cases.positions([("x", a) for a in range(0, 360, 45)] + [("z", 0), ("-z", 0)], 60.0)
    places = Positions(places.angle, places.mounting, places.dwell, angle_std=0.0)  # the angles are exact
    truth = Squared(*PAPER, b_a=1e-3, b_g=5e-8, latitude=LATITUDE, k_a=2e-5)
    free, inside = (*FIVE, "k_a"), []
    rng = np.random.default_rng(0)
    clean = truth.measure(places)
    for _ in range(20):
        a, w = (values + white / np.sqrt(60) * rng.normal(size=10) for values, white in zip(clean, (VRW, ARW), strict=True))
        readings = Readings(places, a, w, accel_noise=VRW, gyro_noise=ARW)
        found = fit(readings, LATITUDE, model=Squared(), free=free)
        assert isinstance(found.model, Squared)
        inside.append(abs(found.parameters["k_a"] - 2e-5) < 1.96 * found.std["k_a"])
    # of 20 intervals, 16 to 20 contain the truth with probability 0.997
    assert 16 <= sum(inside) <= 20
    assert found.std["k_a"] < 2e-6
    assert "k_a" in found.summary()
    np.testing.assert_allclose(residuals(truth, Readings(places, *clean, accel_noise=VRW, gyro_noise=ARW)), 0, atol=1e-7)
    with refuses("unknown_name"):
        fit(readings, LATITUDE, free=free)
