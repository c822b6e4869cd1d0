"""One result of every kind with its log. Most are written by hand, since a test of the page needs no real fit."""

import functools

import numpy as np

import jaxcal
from jaxcal import Log
from jaxcal._answer import CAUTION, NOTE, Kind, table
from jaxcal.alignment import AlignmentFit, Positions, Readings, Sensor, Turntable, simulate
from jaxcal.alignment._findings import FINDINGS as NORTH
from jaxcal.alignment._model import NAMES
from jaxcal.alignment._result import QUANTITIES
from jaxcal.device import DeviceFit
from jaxcal.device._findings import FINDINGS as DEVICE
from jaxcal.fitting import Estimate
from jaxcal.imu import Imu, ImuFit, Triad
from jaxcal.imu._findings import FINDINGS as IMU
from jaxcal.imu._model import entries
from jaxcal.imu._observability import Observability
from jaxcal.imu._result import quantities
from jaxcal.magnetometer import body_field, scenario
from jaxcal.noise._findings import FINDINGS

from ..made_fit import made_fit, made_results

EVIL = "<script>alert('x')</script>"


def noise():
    """Noise results of six channels with warnings, and a log with a long name that has three of them."""
    told = (FINDINGS("no_intervals", method=f"a & {EVIL}"),)
    results = dict(made_results()) | {"gyro_y": made_fit(2.0, findings=told)}
    provenance = {"file": "logs/a_rather_long_name_without_any_blank_2026-05-31T10-00-00.csv", "sha256": "ab" * 32}
    provenance["options"] = {"units": {"gyro": "deg/s"}, "band": None}
    said = table(read=Kind(NOTE, "{text}"), doubt=Kind(CAUTION, "{text}"))
    findings = [said("read", text="gyro: rad/s, assumed"), said("doubt", text=f"3 samples {EVIL}")]
    gyro = np.random.default_rng(0).normal(size=(500, 3))
    return results, Log(None, gyro=gyro, rate=200.0, findings=findings, provenance=provenance)


@functools.cache
def thermal():
    """Thermal fits of two sensors, the first with a jump."""
    made = jaxcal.temperature.simulate(seed=1)
    gyro = jaxcal.temperature.fit(made.temperature, made.bias, sensor="gyro")
    accel = jaxcal.temperature.fit(made.temperature, made.bias, model="polynomial", degree=3, sensor="accel")
    return {"gyro_x": gyro, "gyro_y": gyro, "accel_x": accel}, None


def imu():
    """A calibration from twenty poses and nineteen turns; the convention fixes some elements."""
    rng = np.random.default_rng(1)
    gyro = Triad(np.eye(3) + 0.01 * rng.normal(size=(3, 3)), 0.01 * rng.normal(size=3), 1e-5 * rng.normal(size=(3, 3)))
    accel = Triad(np.triu(gyro.matrix), 10 * gyro.bias)
    names, values = entries(Imu(accel, gyro))[0], np.concatenate([np.ravel(part) for part in (
        accel.matrix, accel.bias, gyro.matrix, gyro.bias, gyro.g_sensitivity)])  # fmt: skip
    states = {name: "held" for name, value in zip(names, values, strict=True) if value == 0}
    found = ImuFit(
        accel=accel, gyro=gyro, estimate=Estimate(names, values, np.diag((0.005 * values) ** 2), 30.0, states, quantities()),
        residual_norm=1e-3 * rng.normal(size=20), residual_turn=np.abs(1e-3 * rng.normal(size=19)),
        residual_rest=1e-4 * rng.normal(size=(20, 3)), sigma=np.array([1e-3, 1e-3, 1e-4]),
        down_weighted=(np.array([3]), np.array([5, 6])), held_out=np.array([1.1e-3, 1.2e-3]),
        observability=Observability(20, 2.0, ("bias along x",), np.zeros((0, 3)), 1.5), rate=100.0, gravity=9.81, temperature=np.nan,
        findings=(IMU("gyro_axes", "gyro", severity=NOTE, what="z is reversed", axes=EVIL),), convention="upper", method="joint",
    )  # fmt: skip
    steady = np.tile([0, 0, 9.81], (200, 1))
    return found, Log(None, accel=steady, gyro=0 * steady, rate=100.0)


def mag():
    """A magnetometer fit of noisy readings in all attitudes."""
    rng = np.random.default_rng(0)
    m = body_field(scenario("all"), 50e-6) + [2e-5, -1e-5, 0] + 3e-7 * rng.normal(size=(360, 3))
    return jaxcal.magnetometer.fit(m), Log(None, mag=m, rate=50.0)


def joint():
    """A device moved for forty seconds, with a rest and a disturbed interval; the delay of its magnetometer is not determined."""
    log, model, true = jaxcal.device.simulate(40.0, seed=2, rests=1, iron=(30.0, 36.0, 0.3))
    values = {}
    for part, field in (("accel", "matrix"), ("accel", "bias"), ("gyro", "matrix"), ("gyro", "bias"), ("magnetometer", "soft_iron"),
                        ("magnetometer", "hard_iron")):  # fmt: skip
        array = np.asarray(getattr(getattr(model, part), field))
        values |= {f"{part}.{field}[{','.join(map(str, i))}]": x for i, x in np.ndenumerate(array)}
    values |= {name: getattr(model, name) for name in ("dip", "gyro_delay", "mag_delay", "field")}
    names, known = tuple(values), np.array([float(x) for x in values.values()])
    half = np.where(known == 0, 0.0, 1e-3 * np.abs(known))
    states = {name: "held" for name, x in values.items() if x == 0} | {"mag_delay": "open"}
    quantities = {"accel.bias": "accel", "gyro.bias": "gyro", "magnetometer.hard_iron": "mag", "field": "mag", "dip": "angle",
                  "gyro_delay": "delay", "mag_delay": "delay"}  # fmt: skip
    rng, ends = np.random.default_rng(3), slice(None, None, 20)
    count = len(true.time[ends]) - 1
    findings = DEVICE("undetermined", "magnetometer"), DEVICE("other_axes", axes=f"gyroscope {EVIL}", typed="gyro=x,y,-z")
    found = DeviceFit(
        findings=findings, model=model, estimate=Estimate(names, known, np.diag((half / 1.96) ** 2), states=states, quantities=quantities),
        disturbed=((30.5, 35.5),), rests=((18.0, 22.0),), noise={"gyro": 1e-4, "accel": 1e-3, "mag": 2e-7}, reach=0.25, speed=0.3,
        disagreement=1.1, time=true.time[ends], attitude=true.attitude[ends], velocity=true.velocity[ends], place=true.position[ends],
        residual_inertial=rng.normal(size=(count, 9)), residual_field=1e-7 * np.abs(rng.normal(size=(count, 3))), gravity=9.80665,
        rate=100.0, duration=40.0, held_out=dict.fromkeys(("accel", "gyro", "magnetometer"), 1.1),
    )  # fmt: skip
    return found, log


def north():
    """North finding from six positions: one has another mounting, one reading is missing, and a prior alone determines a scale error."""
    where = Positions(np.deg2rad([0.0, 90, 180, 270, 0, 45]), mounting=("x", "x", "x", "x", "z", "x"))
    angles, latitude = np.array([0.035, -0.017, 0.7]), 0.6
    made = simulate(where, angles, latitude, accel=Sensor(white=5e-4), gyro=Sensor(white=3e-6))
    gyro = np.asarray(made.gyro).copy()
    gyro[5] = np.nan
    readings = Readings(where, accel=np.asarray(made.accel), gyro=gyro, accel_noise=5e-4, gyro_noise=3e-6)
    count = len(NAMES)
    values, size = np.zeros((2, count))
    values[:6], values[-1] = [*angles, 3e-4, 2e-4, -1.2e-6], latitude
    size[:6] = 3.6e-5, 3.6e-5, 3.5e-2, 2.5e-4, 1e-3, 1.5e-6
    states = dict.fromkeys(NAMES[6:], "held")
    fit = AlignmentFit(
        model=Turntable(*values), readings=readings,
        estimate=Estimate(NAMES, values, np.diag(size**2), states=states, quantities=QUANTITIES),
        rank=6, hidden=np.zeros(count, bool), lost=np.zeros(count, bool),
        prior_only=np.arange(count) == 4, accel_residual=np.linspace(-1, 1, 6), gyro_residual=np.linspace(1, -1, 6), chi_square=3.1,
        degrees_of_freedom=5, p_value=0.68, noise_known=True, findings=(NORTH("prior_alone", names=EVIL),),
    )  # fmt: skip
    return fit, None


def allan():
    """Allan deviations of two channels, and the log."""
    log = noise()[1]
    return {name: jaxcal.allan.deviation(values, log.rate) for name, values in list(log.channels().items())[:2]}, log


def psd():
    """A spectrum that is not averaged and contains a spectral line."""
    log = noise()[1]
    values = log.gyro[:, 0] + 5 * np.sin(2 * np.pi * 40 * log.time)
    return {"gyro_x": jaxcal.spectrum.density(np.tile(values, 8), log.rate, average=None)}, log


KINDS = {"noise": noise, "allan": allan, "psd": psd, "thermal": thermal, "imu": imu, "mag": mag, "joint": joint, "north": north}
