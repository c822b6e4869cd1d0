"""`jaxcal simulate north`: readings of a turntable whose attitude is known."""

import math
from pathlib import Path
from typing import Any

from ._options import CallError, Running
from ._outputs import staged
from ._screen import Screen, show_written
from ._simulate import noise_from_text

_DEG = math.pi / 180


def simulate_north(
    *,
    out: Path,
    latitude: float,
    attitude: str = "0,0,0",
    positions: str = "0,90,180,270",
    dwell: float = 60.0,
    gyro: str = "N=0.01deg/sqrt(h)",
    accel: str = "N=0.03m/s/sqrt(h)",
    gyro_bias: float = 0.0,
    accel_bias: float = 0.0,
    gyro_scale: float = 0.0,
    accel_scale: float = 0.0,
    running: Running = Running(),
) -> None:
    """A table of turntable readings for `jaxcal north`.

    Parameters
    ----------
    out
        File to write: FILE.csv.
    latitude
        Degrees, north positive.
    attitude
        Roll, pitch and azimuth of the table in degrees.
    positions
        Table angles in degrees; z and -z for the sensors remounted, z90 at another angle: 0,90,180,270,z,-z.
    dwell
        Time on each position in s.
    gyro
        Noise of the gyro; N and K count.
    accel
        Noise of the accelerometer.
    gyro_bias
        In deg/h.
    accel_bias
        In micro-g.
    gyro_scale
        Scale error in ppm.
    accel_scale
        Scale error in ppm.
    """
    if out.suffix != ".csv":
        raise CallError(f"--out {out}: expected a name that ends in .csv")
    if not -90 <= latitude <= 90:
        raise CallError(f"--latitude {latitude:g}: expected degrees from -90 to 90")
    if not 0 < dwell < math.inf:
        raise CallError(f"--dwell {dwell:g}: expected a positive number of s")
    angles = _numbers("--attitude", attitude)
    if len(angles) != 3:
        raise CallError(f"--attitude {attitude}: expected roll, pitch and azimuth in degrees, such as 1,2,88")
    places = [_position(word.strip()) for word in positions.split(",")]
    noise = noise_from_text(gyro, "gyro"), noise_from_text(accel, "accel")
    with staged([out]) as rooms:
        from ..alignment import Positions, Sensor, simulate as made

        known = Positions([angle * _DEG for _, angle in places], [word for word, _ in places], dwell)
        rate = Sensor(gyro_scale * 1e-6, (0.0, 0.0), gyro_bias * _DEG / 3600, white=float(noise[0].N), walk=float(noise[0].K))
        force = Sensor(accel_scale * 1e-6, (0.0, 0.0), accel_bias * 9.80665e-6, white=float(noise[1].N), walk=float(noise[1].K))
        found = made(known, [angle * _DEG for angle in angles], latitude * _DEG, accel=force, gyro=rate, seed=running.seed)
        _save(rooms[out], places, dwell, found)
    show_written(Screen(running.quiet), [out])


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise CallError(f"{option} {text}: expected numbers with commas between them") from None


def _position(word: str) -> tuple[str, float]:
    for mounting in ("-z", "z"):
        if word.startswith(mounting):
            return mounting, _numbers("--positions", word.removeprefix(mounting) or "0")[0]
    return "x", _numbers("--positions", word)[0]


def _save(place: Path, places: list[tuple[str, float]], dwell: float, found: Any) -> None:
    lines = ["angle [deg],mounting,dwell [s],accel [m/s^2],gyro [deg/h]"]
    for (word, angle), a, w in zip(places, found.accel, found.gyro, strict=True):
        lines.append(f"{angle:.10g},{word},{dwell:g},{float(a):.12g},{float(w) / _DEG * 3600:.12g}")
    place.write_text("\n".join(lines) + "\n", encoding="utf-8")
