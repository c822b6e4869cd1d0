"""Files written by jaxcal are read back: writing again gives the bytes that `test_formulas` checks; damaged files are refused."""

import pathlib
import struct

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from jaxcal import Calibration, DataError, JaxcalError
from jaxcal.export import read, write

from ..made_calibration import made

FOLDER = pathlib.Path(__file__).parent
GOLDEN = FOLDER / "golden"
PAIRS = [
    *((format, {}) for format in ("kalibr", "px4", "ardupilot", "motioncal")),
    ("px4", {"instance": 3}), ("ardupilot", {"instance": 2, "gyro_bias": True}),
]  # fmt: skip


@pytest.fixture(scope="module")
def golden():
    return Calibration.load(FOLDER / "golden.json")


def data_lines(path, binary):
    """Lines of a file without comments; all bytes of a binary file."""
    if binary:
        return path.read_bytes()
    return [line for line in path.read_text().splitlines() if not line.startswith("#")]


@pytest.mark.parametrize("seed", [None, 1, 2, 3])
@pytest.mark.parametrize(("format", "options"), PAIRS)
def test_write_read_write_gives_the_same_bytes(golden, tmp_path, format, options, seed):
    device = golden if seed is None else made(seed)
    first, second, third = (tmp_path / name for name in "abc")
    write(device, first, format=format, **options)
    where = {"instance": options["instance"]} if "instance" in options else {}
    again = read(first, format=format, **where)
    write(again, second, format=format, **options)
    assert data_lines(first, format == "motioncal") == data_lines(second, format == "motioncal")
    write(read(second, format=format, **where), third, format=format, **options)
    assert second.read_bytes() == third.read_bytes()  # including comments


def test_openvins_comes_back_but_for_its_frame(tmp_path):
    """The file has nine digits. A rotation of the frame, which both matrices share, leaves M inv(G) as it is."""
    device = made(1)
    write(device, tmp_path / "a", format="openvins")
    accel, gyro = (part.model.matrix for part in device.imu.parts.values())
    again = read(tmp_path / "a", format="openvins")
    np.testing.assert_allclose(
        [again.noise.gyro.N[0], again.noise.accel.K[0]], [device.noise.gyro.N.max(), device.noise.accel.K.max()], rtol=1e-8
    )
    found = [part.model.matrix for part in again.imu.parts.values()]
    np.testing.assert_allclose(found[0] @ np.linalg.inv(found[1]), accel @ np.linalg.inv(gyro), rtol=0, atol=5e-9)
    np.testing.assert_allclose(found[0] @ found[0].T, accel @ accel.T, rtol=0, atol=5e-9)


@pytest.mark.parametrize("seed", [None, 1, 2, 3])
def test_imu_tk_comes_back(golden, tmp_path, seed):
    device = golden if seed is None else made(seed)
    write(device, tmp_path / "a.calib", format="imu_tk")
    again = read(tmp_path / "a.calib", format="imu_tk")
    write(again, tmp_path / "b.calib", format="imu_tk")
    for sensor, suffix in (("accel", "acc"), ("gyro", "gyro")):
        assert (tmp_path / f"a_{suffix}.calib").read_bytes() == (tmp_path / f"b_{suffix}.calib").read_bytes()
        np.testing.assert_allclose(getattr(again.imu, sensor).model.matrix, getattr(device.imu, sensor).model.matrix, rtol=0, atol=1e-11)
        assert list(read(tmp_path / f"a_{suffix}.calib", format="imu_tk").imu.parts) == [sensor]


def test_several_instances_in_one_file(golden, tmp_path, refuses):
    devices = [made(1), made(2)]
    for format in ("px4", "ardupilot"):
        write(devices, tmp_path / "a", format=format)
        for i, device in enumerate(devices):
            found = read(tmp_path / "a", format=format, instance=i)
            np.testing.assert_allclose(found.magnetometer.model.hard_iron, device.magnetometer.model.hard_iron, rtol=1e-8)
            reach = found.temperature.reference - 35.0
            assert reach == 0
            np.testing.assert_allclose(found.temperature.powers("accel"), device.temperature.powers("accel"), rtol=1e-6)
    with refuses("several"):
        write(devices, tmp_path / "a", format="kalibr")
    lines = (tmp_path / "a").read_text()
    names = "COMPASS_OFS2_X COMPASS_DEV_ID2 INS_ACC2OFFS_X INS_ACC2SCAL_Z INS_ACC2_CALTEMP INS_ACC2_ID INS_TCAL2_TMIN"
    assert all(f"\n{name}," in lines for name in names.split())
    assert all(len(line.split(",")[0]) <= 16 for line in lines.splitlines() if not line.startswith("#"))


def test_the_result_of_kalibr(tmp_path):
    """A result file of Kalibr, imitated with PyYAML, is read by accel = M_a a and gyro = M_g C w + A C a."""
    turn = Rotation.from_rotvec([0.01, -0.02, 0.03]).as_matrix()
    ma, mg, a = np.tril(np.full((3, 3), 0.01)) + np.eye(3), np.eye(3) - np.tril(np.full((3, 3), 0.02)), np.full((3, 3), 1e-4)
    document = {"imu0": {
        "T_i_b": np.eye(4).tolist(), "accelerometer_noise_density": 0.01, "accelerometer_random_walk": 1e-4,
        "accelerometers": {"M": ma.tolist()}, "gyroscope_noise_density": 0.02, "gyroscope_random_walk": 2e-4,
        "gyroscopes": {"A": a.tolist(), "C_gyro_i": turn.tolist(), "M": mg.tolist()}, "model": "scale-misalignment",
        "rostopic": "/imu0", "time_offset": 0.0, "update_rate": 200.0,
    }}  # fmt: skip
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(document, default_flow_style=None).replace("1.0e-4", "0.0001"))
    found = read(tmp_path / "a.yaml", format="kalibr")
    np.testing.assert_allclose(found.imu.accel.model.matrix, ma)
    np.testing.assert_allclose(found.imu.gyro.model.matrix, mg @ turn)
    np.testing.assert_allclose(found.imu.gyro.model.g_sensitivity, a @ turn)
    assert found.noise.gyro.N[0] == 0.02


def test_thermal_constants_of_px4_go_to_the_bias(golden, tmp_path):
    write(golden, tmp_path / "a", format="px4")
    text = (tmp_path / "a").read_text()
    (tmp_path / "a").write_text(text.replace("TC_A0_X0_1\t0\t9", "TC_A0_X0_1\t0.5\t9"))
    assert read(tmp_path / "a", format="px4").imu.accel.model.bias[1] == pytest.approx(0.42)
    (tmp_path / "a").write_text(text.replace("TC_A_ENABLE\t1", "TC_A_ENABLE\t0"))
    assert not read(tmp_path / "a", format="px4").temperature.of("accel")


def test_the_scale_of_a_compass_multiplies(golden, tmp_path):
    write(golden, tmp_path / "a", format="ardupilot")
    text = (tmp_path / "a").read_text().replace("COMPASS_SCALE,1", "COMPASS_SCALE,2")
    (tmp_path / "a").write_text(text.replace(",", " "))  # MAVProxy separates by blanks
    found = read(tmp_path / "a", format="ardupilot").magnetometer
    np.testing.assert_allclose(
        np.linalg.inv(found.model.soft_iron), 2 * np.linalg.inv(golden.magnetometer.model.soft_iron), rtol=1e-8, atol=1e-9
    )


def checksum(data):
    """CRC-16 with the polynomial x^16 + x^15 + x^2 + 1 and reflected bits, computed by long division of the whole message."""
    bits = [byte >> k & 1 for byte in data for k in range(8)] + [0] * 16
    bits[:16] = [bit ^ 1 for bit in bits[:16]]  # the register starts with ones
    for i in range(len(bits) - 16):
        if bits[i]:
            for k in (0, 1, 14, 16):
                bits[i + k] ^= 1
    return sum(bit << k for k, bit in enumerate(bits[-16:]))


def test_packets_of_motioncal(golden, tmp_path, refuses):
    packet = bytes.fromhex((GOLDEN / "motioncal.hex").read_text())
    (tmp_path / "a").write_bytes(packet)
    found = read(tmp_path / "a", format="motioncal").magnetometer
    np.testing.assert_allclose(np.linalg.inv(found.model.soft_iron) @ ([20, 10, -35] - found.model.hard_iron * 1e6),
                               [8.82016591, 14.8486051, -64.1947983], atol=2e-5)  # float32 of an offset of 65 uT  # fmt: skip
    assert found.field == pytest.approx(47.73032e-6, rel=1e-6)
    assert struct.pack("<H", checksum(packet[:-2])) == packet[-2:]
    for i in range(len(packet)):
        (tmp_path / "c").write_bytes(packet[:i] + bytes([packet[i] ^ 1]) + packet[i + 1 :])
        with refuses("unreadable"):
            read(tmp_path / "c", format="motioncal")


def test_yaml_of_opencv_and_numbers_without_a_point(tmp_path):
    names = (
        "gyroscope_noise_density: 1e-3",
        "accelerometer_noise_density: 2.0e-3",
        "gyroscope_random_walk: 3e-5",
        "accelerometer_random_walk: 4",
    )
    lines = "".join(f"   {line}\n" for line in (*names, "update_rate: 200"))
    matrix = "   T_b_c1: !!opencv-matrix\n      rows: 4\n      dt: f\n      data: [1.0, 0.0,\n         0.0]\n"
    (tmp_path / "a.yaml").write_text(f"%YAML:1.0\n---\nimu0:\n{matrix}{lines}")
    noise = read(tmp_path / "a.yaml", format="kalibr").noise
    assert (noise.gyro.N[0], noise.accel.N[1], noise.gyro.K[2], noise.accel.K[0], noise.rate) == (1e-3, 2e-3, 3e-5, 4.0, 200.0)


@pytest.mark.parametrize(
    "text",
    ["", "a", "- 1\n- 2", "a: {b: 1}", "a: &x 1\nb: *x", "a: 1\n   b: 2", "\ta: 1", "a: [1, [2]]", "a: [1", "a: 1\na: 2", "a: |\n  text",
     "a: " + "[" * 5000, "a: !!python/object/apply:os.system [x]", "a: 2020-99-99", "? [1]\n: 2", "1: 2", "a: x" * 2**19],
    ids=range(17),
)  # fmt: skip
@pytest.mark.parametrize("format", ["kalibr", "openvins"])
def test_yaml_beyond_calibrations_is_refused(tmp_path, text, format):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(DataError):
        read(tmp_path / "a.yaml", format=format)


FILES = {
    "kalibr": "imu.yaml", "openvins": "kalibr_imu_chain.yaml", "px4": "px4.params", "ardupilot": "ardupilot.param",
    "imu_tk": "golden_acc.calib",
}  # fmt: skip


@pytest.mark.parametrize("format", FILES)
def test_damage_never_gets_through(tmp_path, format):
    """A file with random bytes changed, removed or repeated is refused, or its numbers are finite."""
    data = (GOLDEN / FILES[format]).read_bytes()
    draw = np.random.default_rng(5)
    refused = 0
    path = tmp_path / "x_acc.calib"
    for _ in range(150):
        letters = bytearray(data)
        for _ in range(draw.integers(1, 4)):
            i, kind = draw.integers(len(letters)), draw.integers(3)
            if kind == 0:
                letters[i] = draw.choice(list(b"0123456789-.e ,\t\n[]:#x\xff"))
            elif kind == 1:
                del letters[i : i + int(draw.integers(1, 20))]
            else:
                letters[i:i] = letters[i : i + int(draw.integers(1, 20))]
        path.write_bytes(bytes(letters))
        try:
            found = read(path, format=format)
        except JaxcalError:
            refused += 1
            continue
        for part in () if found.imu is None else found.imu.parts.values():
            assert np.isfinite(part.model.matrix).all()
    assert refused > 15


def test_what_cannot_be_read(tmp_path, refuses):
    for format in ("gtsam", "vins", "csv", "json"):
        with refuses("format"):
            read(tmp_path / "a", format=format)
    for format in ("kalibr", "imu_tk", "motioncal"):
        with refuses("unreadable"):
            read(tmp_path / "a", format=format)
    (tmp_path / "a").write_bytes(b"\xff\xfe")
    with refuses("unreadable"):
        read(tmp_path / "a", format="px4")
    for options in ({"rate": -1}, {"instance": -1}):
        with refuses("option"):
            read(tmp_path / "a", format="px4", **options)
