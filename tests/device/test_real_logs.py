"""`jaxcal.device.fit` on logs of others (`JAXCAL_REFERENCE`): halves beside each other, and beside the magnetometer alone."""

import numpy as np
import pytest

import jaxcal

GRAVITY = 9.8127  # m/s^2 in Berlin
#: rms over a group of what two halves differ by, in the errors that they predict; the bias of the gyroscope drifts in this log, see docs
GROUPS = ("accel.matrix", "accel.bias", "gyro.matrix", "magnetometer.soft_iron", "magnetometer.hard_iron", "dip", "gyro_delay", "mag_delay")


@pytest.fixture(scope="module")
def broad(reference):
    """A recording by hand of the BROAD data set, 207 s at 286 Hz with five rests."""
    path = reference / "data" / "logs" / "broad_05_slow_rotation_B.hdf5"
    if not path.exists():
        pytest.skip(f"no log at {path}")
    return jaxcal.read(path)


@pytest.fixture(scope="module")
def sunsided(reference):
    """A recording of 106 s through all attitudes; the stamps come in bursts, and those of the magnetometer are its own."""
    h5py = pytest.importorskip("h5py", reason="h5py reads MATLAB 7.3")
    read = {}
    for name, variable in (
        ("mpu6050_gyroscope", "gyroBuffer"),
        ("mpu6050_accelerometer", "accelBuffer"),
        ("hmc5883l_compass", "compassBuffer"),
    ):
        path = reference / "data" / "magnetometer" / "sunsided" / f"{name}.mat"
        if not path.exists():
            pytest.skip(f"no log at {path}")
        with h5py.File(path) as file:
            table = np.array(file[variable])
        read[variable] = table if table.shape[1] == 4 else table.T
    gyro, accel, mag = read.values()
    return jaxcal.Log(
        gyro[:, 0], gyro=np.deg2rad(gyro[:, 1:]), accel=accel[:, 1:] * 9.80665, mag=mag[:, 1:] * 1e-4, own_time={"mag": mag[:, 0]}
    )


def assert_halves_agree(log, half, groups, **options):
    first, second = (jaxcal.device.fit(log.select(a, a + half), **options) for a in (0.0, half))
    with np.errstate(invalid="ignore"):
        apart = (first.estimate.values - second.estimate.values) / np.hypot(first.estimate.error, second.estimate.error)
    for group in groups:
        own = [z for z, name in zip(apart, first.estimate.names, strict=True) if name.startswith(group) and np.isfinite(z)]
        assert not own or np.sqrt(np.mean(np.square(own))) < 1.5, group


@pytest.mark.long
def test_halves_of_a_real_log_agree(broad):
    assert_halves_agree(broad, 103.6, GROUPS, gravity=GRAVITY)


@pytest.mark.long
def test_halves_of_a_real_log_with_two_clocks_agree(sunsided):
    assert_halves_agree(sunsided, sunsided.duration / 2, (*GROUPS, "gyro.bias", "field"))


@pytest.mark.long
def test_a_real_log_agrees_with_its_magnetometer_alone_and_with_the_cameras(broad):
    found, alone = jaxcal.device.fit(broad, gravity=GRAVITY), jaxcal.magnetometer.fit(broad.mag)
    own = found.estimate.select("magnetometer.hard_iron*")
    other = alone.estimate.select("hard_iron*").error
    assert np.abs((own.values - alone.model.hard_iron) / np.hypot(own.error, other)).max() < 2
    # the hand stayed within 0.2 m, as cameras saw it
    assert found.reach < 0.3
    # their attitudes and gravity give this bias of the accelerometer, to about 0.02 m/s^2
    low, high = found.estimate.select("accel.bias*").intervals().T
    assert ((low - 0.02 < [-0.005, 0.005, -0.027]) & (high + 0.02 > [-0.005, 0.005, -0.027])).all()


@pytest.mark.long
def test_axes_are_named_where_the_magnetometer_shows_no_ellipsoid(reference):
    path = reference / "data" / "logs" / "fusion_sensor_data.csv"
    if not path.exists():
        pytest.skip(f"no log at {path}")
    log, turn = jaxcal.read(path, quiet=True), np.eye(3)[[1, 2, 0]]
    found = jaxcal.device.fit(jaxcal.Log(None, accel=log.accel, gyro=log.gyro, mag=log.mag @ turn.T, rate=log.rate))
    assert [(*one.subject, one.facts["typed"]) for one in found.findings if one.code == "other_axes"] == [("magnetometer", "mag=z,x,y")]
