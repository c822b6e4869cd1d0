"""Intervals, bound and noise of north finding against a simulation that uses no code of jaxcal."""

import numpy as np
import pytest
import scipy.stats

import jaxcal
from jaxcal.alignment import Positions, Readings, Sensor, crlb, fit, noise_of, plan, simulate
from jaxcal.noise import Noise

from . import cases, world
from .cases import ARW, DEG, VRW

ATTITUDE = np.array([1.0, 2.0, 40.0]) * DEG
GIVEN = {kind: [Noise(**dict(zip("NBK", c * keep, strict=True))) for c in (world.ACCEL, world.GYRO)] for kind, keep in world.NOISES.items()}


def covered(plan_name, kind, known, runs, seed=5):
    """Share of 95 % intervals that contain the true roll, pitch and azimuth, and the rmse of the azimuth divided by its bound."""
    angle, start, dwell, accel, gyro = world.tables(np.random.default_rng(seed), runs, plan_name, kind, ATTITUDE)
    places = Positions(angle, dwell=dwell, start=start, angle_std=0.0)
    noise = dict(zip(("accel_noise", "gyro_noise"), GIVEN[kind], strict=True))
    inside, errors = [], []
    for a, w in zip(accel, gyro, strict=True):
        found = fit(Readings(places, a, w, **(noise if known else {})), world.LATITUDE)
        limits = {name: (found.estimate[name].low, found.estimate[name].high) for name in ("phi", "theta", "psi")}
        inside.append([limits[name][0] <= truth <= limits[name][1] for name, truth in zip(("phi", "theta", "psi"), ATTITUDE, strict=True)])
        errors.append(np.nan if found.psi is None else found.psi - ATTITUDE[2])
    bound = crlb(places, ATTITUDE, world.LATITUDE, **noise)
    return np.mean(inside, axis=0), np.sqrt(np.nanmean(np.square(errors))) / bound.azimuth_std


EVERY = [(plan, kind, known, 400) for plan in world.PLANS for kind in world.NOISES for known in (True, False)[: 1 + (kind == "white")]]


@pytest.mark.parametrize(
    ("plan_name", "kind", "known", "runs"),
    [("8 mirrored x 60 s", "N+B+K", True, 30), ("4 x 120 s", "white", False, 30),
     *(pytest.param(*one, marks=pytest.mark.long) for one in EVERY)],
)  # fmt: skip
def test_intervals_hold_the_truth(plan_name, kind, known, runs):
    share, ratio = covered(plan_name, kind, known, runs)
    assert np.all(np.abs(share - 0.95) < 3 * np.sqrt(0.95 * 0.05 / runs)), share
    assert ratio == pytest.approx(1, abs=3 / np.sqrt(2 * runs))


def test_the_bound_under_flicker_is_that_of_generalised_least_squares():
    """With a known level, psi and bias are unknown; the covariance is summed over all samples from the semivariogram of flicker."""
    angles, dwell, dt = np.array([0, 90, 180, 270]) * DEG, 60.0, 0.5
    start = 70.0 * np.arange(4)
    h = np.arange(1200)
    gamma = 2 * world.GYRO[1] ** 2 / np.pi * np.concatenate([[0], np.cumsum(1 / (2 * h[1:] - 1))])
    samples = [np.round((s + np.arange(0, dwell, dt)) / dt).astype(int) for s in start]
    flicker = np.array([[-np.mean(gamma[np.abs(i[:, None] - j[None, :])]) for j in samples] for i in samples])
    covariance = flicker + np.eye(4) * world.GYRO[0] ** 2 / dwell + 10 * gamma[-1]
    level = np.array([0.0, 0.0, 40.0]) * DEG
    rows = np.stack([-world.EARTH * np.cos(world.LATITUDE) * np.sin(angles + level[2]), np.ones(4)], axis=1)
    expected = np.sqrt(np.linalg.inv(rows.T @ np.linalg.solve(covariance, rows))[0, 0])
    places = Positions(angles, dwell=dwell, start=start)
    found = crlb(places, level, world.LATITUDE, accel_noise=VRW, gyro_noise=GIVEN["N+B"][1], free=("psi", "b_g"))
    assert found.azimuth_std == pytest.approx(expected, rel=2e-3)
    assert found.azimuth_std > 1.5 * crlb(places, level, world.LATITUDE, accel_noise=VRW, gyro_noise=world.GYRO[0]).azimuth_std


def test_plan_knows_flicker():
    noise = dict(zip(("accel_noise", "gyro_noise"), GIVEN["N+B"], strict=True))
    found = plan(600.0, world.LATITUDE, attitude=ATTITUDE, mountings=("x",) * 4, **noise)
    priors = {"free": ("phi", "theta", "psi", "b_a", "s_a", "b_g", "s_g"), "priors": {"s_a": 1e-4, "s_g": 1e-4}}
    again = crlb(found.positions, ATTITUDE, world.LATITUDE, **noise, **priors)
    assert again.azimuth_std == pytest.approx(found.criterion, rel=1e-6)
    uniform = Positions(np.array([0, 90, 180, 270]) * DEG, dwell=150.0)
    assert found.criterion < crlb(uniform, ATTITUDE, world.LATITUDE, **noise, **priors).azimuth_std


def test_student_quantiles_follow_the_readings_that_are_left_over():
    made = simulate(cases.positions([("x", a) for a in (0, 90, 180, 270)], 60.0), ATTITUDE, world.LATITUDE, accel=Sensor(white=VRW),
                    gyro=Sensor(white=ARW), seed=1)  # fmt: skip
    found = fit(Readings(made.positions, made.accel, made.gyro), world.LATITUDE)
    freedom = dict(zip(found.names, found.estimate.freedom, strict=True))
    # of four readings each, the accelerometer determines roll, pitch and bias, the gyro azimuth and bias
    assert freedom["phi"] == pytest.approx(1, rel=1e-3)
    assert freedom["psi"] == pytest.approx(2, rel=1e-3)
    assert found.estimate["psi"].half == pytest.approx(scipy.stats.t.ppf(0.975, 2) * found.std["psi"], rel=1e-3)
    assert np.all(np.isinf(fit(made, world.LATITUDE).estimate.freedom))
    one = fit(Readings(made.positions, made.accel, made.gyro, accel_noise=VRW), world.LATITUDE)
    assert one.estimate.freedom[0] > 1e6
    assert one.estimate.freedom[2] == pytest.approx(2, rel=1e-3)


def test_errors_of_the_table_angles_widen_the_azimuth():
    """The bound agrees with a covariance in NumPy, in which gyro and accelerometer at one position share the error of its angle."""
    angles, sigma = np.array([0, 90, 180, 270]) * DEG, 0.1 * DEG
    places = Positions(angles, dwell=60.0, angle_std=sigma)
    noise = {"accel_noise": VRW, "gyro_noise": ARW / 10}
    bound = crlb(places, ATTITUDE, world.LATITUDE, **noise)
    step = 1e-5

    def readings(x):
        return np.concatenate([v[:, 0] for v in world.vectors(x[:3], angles + x[5:])]) + np.repeat(x[3:5], 4)

    at = np.concatenate([ATTITUDE, np.zeros(6)])
    rows = np.stack([(readings(at + step * e) - readings(at - step * e)) / (2 * step) for e in np.eye(9)], axis=1)
    rows = rows / np.repeat([VRW, ARW / 10], 4)[:, None] * np.sqrt(60.0)
    information = rows.T @ rows + np.diag([0] * 5 + [sigma**-2] * 4)
    expected = np.linalg.inv(information)[:3, :3]
    np.testing.assert_allclose(bound.covariance[:3, :3], expected, rtol=1e-5)
    assert bound.azimuth_std > 1.5 * crlb(Positions(angles, dwell=60.0), ATTITUDE, world.LATITUDE, **noise).azimuth_std
    rng, inside = np.random.default_rng(2), []
    for _ in range(30):
        clean = [v[:, 0] for v in world.vectors(ATTITUDE, angles + sigma * rng.normal(size=4))]
        noisy = [v + n / np.sqrt(60.0) * rng.normal(size=4) for v, n in zip(clean, (VRW, ARW / 10), strict=True)]
        found = fit(Readings(places, *noisy, **noise), world.LATITUDE)
        inside.append(found.estimate["psi"].low <= ATTITUDE[2] <= found.estimate["psi"].high)
    assert np.mean(inside) > 0.95 - 3 * np.sqrt(0.95 * 0.05 / 30)


def test_noise_of_fits_and_calibrations(refuses):
    fits = {
        f"gyro_{x}": jaxcal.noise.fit(Noise(N=1e-3 * (i + 1)).simulate(2000, 10.0, seed=i), 10.0, method="slope")
        for i, x in enumerate("xyz")
    }
    stored = {"unit": "rad/s", **dict.fromkeys("QBKR"), "N": [fit.noise.N for fit in fits.values()]}
    device = jaxcal.Calibration(noise={"rate": 10.0, "gyro": stored})
    for source in (fits, device):
        held = noise_of(source, "y")
        assert held["accel_noise"] is None
        assert pytest.approx(fits["gyro_y"].noise.N) == held["gyro_noise"].N
        assert [one.N for one in noise_of(source, None)["gyro_noise"]] == pytest.approx([f.noise.N for f in fits.values()])
    angles = np.array([0, 90, 180, 270]) * DEG
    readings = Readings(Positions(angles, dwell=60.0), *(v[:, 0] for v in world.vectors(ATTITUDE, angles)), accel_noise=VRW)
    found = fit(readings, world.LATITUDE, noise=device)
    assert found.std["psi"] == fit(readings, world.LATITUDE, noise={"gyro": float(fits["gyro_x"].noise.N)}).std["psi"]
    assert found.noise_known
    for source, code in ((jaxcal.Calibration(), "no_noise"), ({"gyro": "N"}, "noise")):
        with refuses(code):
            noise_of(source)
    with refuses("axis"):
        noise_of(device, "w")
    with refuses("noise"):
        fit(readings, world.LATITUDE, noise={"gyro": Noise(B=1e-7)})
