"""Files written by jaxcal are read back: writing again gives the bytes that `test_formulas` checks; damaged files are refused."""

import pathlib
import struct

import numpy as np
import pytest

from jaxcal import Calibration, JaxcalError
from jaxcal.export import read, write

from ..made_calibration import made

FOLDER = pathlib.Path(__file__).parent
GOLDEN = FOLDER / "golden"
PAIRS = [
    *((format, {}) for format in ("px4", "ardupilot", "motioncal")),
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


FILES = {"px4": "px4.params", "ardupilot": "ardupilot.param"}


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
    for format in ("gtsam", "kalibr", "csv", "json"):
        with refuses("format"):
            read(tmp_path / "a", format=format)
    with refuses("unreadable"):
        read(tmp_path / "a", format="motioncal")
    (tmp_path / "a").write_bytes(b"\xff\xfe")
    with refuses("unreadable"):
        read(tmp_path / "a", format="px4")
    with refuses("option"):
        read(tmp_path / "a", format="px4", instance=-1)
