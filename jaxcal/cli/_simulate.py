"""`jaxcal simulate`: logs of simulated devices with known parameters."""

import math
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from .._units import STANDARD_GRAVITY, noise_factor, noise_units, si_unit
from ._options import CallError, Field, Latitude, LogFile, Simulating, checked, numbers
from ._outputs import staged
from ._screen import Screen, progress, show_written

Rate = Annotated[float, Parameter(help="Sampling rate in Hz.")]
Duration = Annotated[float, Parameter(help="Length of the log in s.")]
GyroNoise = Annotated[str | None, Parameter(help="Noise of each gyroscope axis, as N=0.25deg/sqrt(h),B=7.6deg/h.")]
AccelNoise = Annotated[str | None, Parameter(help="Noise of each accelerometer axis, as N=0.03m/s/sqrt(h).")]
#: a simulated log: times, values by sensor, and lines on its truth
Made = tuple[Any, dict[str, Any], list[str]]

_TERM = re.compile(r"([QNBKR])\s*=\s*(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+)\s*(.*)")
_DEG = math.pi / 180
_LARGEST = 500_000_000  # samples; more would exceed the memory of most machines
#: a simulated magnetometer: offset in uT, largest entry of what is added to the unit matrix, and dip of the field in degrees
_HARD, _SOFT, _DIP = (21.7, 5.2, -10.2), 0.1, 57.0
_GYRO_BIAS, _ACCEL_BIAS = 0.5, 100.0  # deg/h, micro-g: of simulated sensors on a turntable


def simulate_noise(
    *,
    out: LogFile,
    rate: Rate = 100.0,
    duration: Duration = 3600.0,
    gyro: GyroNoise = None,
    accel: AccelNoise = None,
    running: Simulating = Simulating(),
) -> None:
    """Simulate a level sensor at rest: the given noise, and gravity on accel_z.

    Coefficients are two-sided and have units:
    N=0.25deg/sqrt(h),B=7.6deg/h,K=0.5deg/h/sqrt(s).
    """
    truth = noises(gyro, accel)
    if not truth:
        raise CallError('give the noise of a sensor, as in --gyro "N=0.25deg/sqrt(h),B=7.6deg/h"')
    write_log(out, truth, rate, duration, running)


def simulate_temperature(
    *,
    out: LogFile,
    jump: Annotated[float, Parameter(help="Height of the jump in deg/s.")] = 0.3,
    rate: Rate = 1.0,
    duration: Duration = 5400.0,
    running: Simulating = Simulating(),
) -> None:
    """Simulate a gyroscope at rest whose bias depends on temperature (20 to 45 degC).

    The x axis has a cubic and a jump at 24.5 degC, the y axis the jump
    downwards, the z axis no jump.
    """
    _check_size(rate, duration)

    def make(random: Any) -> Made:
        import numpy as np

        from ..temperature import reference_bias, simulate

        at = np.array([20.0, 32.5, 45.0])
        said = [f"bias at {', '.join(f'{t:g}' for t in at)} degC, with the jump at 24.5 degC"]
        for axis, height in zip("xyz", (jump, -jump, 0.0), strict=True):
            values = reference_bias(at, np.deg2rad(height)) / _DEG
            said.append(f"gyro {axis}: {', '.join(f'{b:+.5f}' for b in values)} deg/s; jump {height:+g} deg/s")
        made = [simulate(jump=np.deg2rad(height), duration=duration, rate=rate, seed=random) for height in (jump, -jump, 0.0)]
        # the log has the thermometer of the first axis; the true temperature is the same for all axes
        return made[0].time, {"gyro": np.stack([one.bias for one in made], axis=1), "temperature": made[0].temperature}, said

    _write(out, make, running)


def simulate_imu(
    *,
    out: LogFile,
    rate: Rate = 100.0,
    poses: Annotated[int, Parameter(help="Number of poses.")] = 24,
    still: Annotated[float, Parameter(help="Length of each pose in s.")] = 4.0,
    turn: Annotated[float, Parameter(help="Length of each turn in s.")] = 3.0,
    gyro: GyroNoise = None,
    accel: AccelNoise = None,
    running: Simulating = Simulating(),
) -> None:
    """Simulate a sensor that is held still in many poses, with turns between them.

    Scale factors, misalignment, biases and g-sensitivity are those of a
    typical MEMS unit (jaxcal.imu.MEMS).
    """
    if poses < 2 or not all(0.0 < x < float("inf") for x in (rate, still, turn)):
        raise CallError("--poses, --rate, --still, --turn: expected 2 poses or more, and positive numbers")
    if rate * poses * (still + turn) > _LARGEST:
        raise CallError(f"--rate {rate:g}: expected a log of at most {_LARGEST} samples")
    given = noises(gyro, accel)

    def make(_: Any) -> Made:
        from ..imu import MEMS, simulate

        log = simulate(poses, rate=rate, still=still, turn=turn, noise=given, seed=running.seed, gravity=STANDARD_GRAVITY)
        return log.time, {"gyro": log.gyro, "accel": log.accel}, _of_triads(MEMS)

    _write(out, make, running)


def simulate_mag(
    *,
    out: LogFile,
    samples: Annotated[int | None, Parameter(help="Attitudes of all (360), or headings of each turn.")] = None,
    noise: Annotated[
        float, Parameter(help="Standard deviation of an axis of a reading in uT; the specific force has the same part of gravity.")
    ] = 0.2,
    field: Annotated[Field, Parameter(help="Norm of the Earth's field in uT.")] = 47.0,
    mounting: Annotated[float, Parameter(help="Angle in degrees by which the magnetometer is turned about its z axis.")] = 0.0,
    running: Simulating = Simulating(),
) -> None:
    """Simulate a magnetometer in many attitudes, with the specific force at rest.

    The command prints the true hard iron, and soft iron with mounting, in the
    form of jaxcal mag, for comparison.
    """
    if not noise >= 0:
        raise CallError(f"--noise {noise:g}: expected uT of 0 or more", "noise")
    if samples is not None and samples < 1:
        raise CallError(f"--samples {samples}: expected at least one")

    def make(random: Any) -> Made:
        import numpy as np

        from ..magnetometer import MagModel, body_field, scenario

        half = random.uniform(-_SOFT, _SOFT, (3, 3))
        angle = np.deg2rad(mounting)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
        true = MagModel((np.eye(3) + (half + half.T) / 2) @ turn, 1e-6 * np.array(_HARD))
        attitudes = scenario("all", samples=samples, seed=running.seed)
        h = np.asarray(body_field(attitudes, 1e-6 * field, np.deg2rad(_DIP)))
        up = -STANDARD_GRAVITY * np.asarray(body_field(attitudes, 1.0, np.pi / 2))
        m = np.asarray(true.measure(h)) + 1e-6 * noise * random.standard_normal(h.shape)
        up = up + STANDARD_GRAVITY * noise / field * random.standard_normal(h.shape)
        size = np.cbrt(np.linalg.det(true.soft_iron))
        said = [
            f"{len(m)} attitudes; hard iron {', '.join(f'{b:g}' for b in _HARD)} uT; soft iron of determinant one",
            *("  " + "  ".join(f"{c:+.5f}" for c in row) for row in np.asarray(true.soft_iron) / size),
            f"as jaxcal mag gives it; with --field {field:g} it is {size:.5f} times that",
        ]
        return np.arange(len(m)) / 10.0, {"accel": up, "mag": m}, said

    _write(out, make, running)


def simulate_device(
    *,
    out: LogFile,
    rate: Rate = 100.0,
    duration: Duration = 180.0,
    rests: Annotated[int, Parameter(help="Number of rests of 4 s on a table.")] = 0,
    turns: Annotated[
        Literal["free", "one-axis", "no-tilt"],
        Parameter(help="free, through all attitudes; one-axis, about one axis of the device; no-tilt, about the vertical."),
    ] = "free",
    gyro: GyroNoise = None,
    accel: AccelNoise = None,
    running: Simulating = Simulating(),
) -> None:
    """Simulate accelerometer, gyroscope and magnetometer, moved by hand.

    The seed determines scale factors, misalignment, biases, hard and
    soft iron and delays, which are those of a consumer MEMS device. The
    command prints them, for comparison with a calibration.
    """
    _check_size(rate, duration)
    given = noises(gyro, accel)
    kinds: dict[str, Any] = {"free": "free", "one-axis": "one axis", "no-tilt": "no tilt"}

    def make(_: Any) -> Made:
        from .._errors import DataError
        from ..device import simulate

        try:
            log, model, _ = simulate(duration, rate, seed=running.seed, rests=rests, turns=kinds[turns], noise=given)
        except DataError as error:
            raise CallError(str(error)) from None
        return log.time, {"accel": log.accel, "gyro": log.gyro, "mag": log.mag}, _told(model)

    _write(out, make, running)


def _told(model: Any) -> list[str]:
    """Lines with the true parameters of a simulated device: matrices, biases, field and delays."""
    iron = model.magnetometer
    lines = [*_of_triads(model), *_of_triad("magnetometer", iron.soft_iron, iron.hard_iron, 1e6, "uT")]
    lines.append(f"field {1e6 * model.field:.4f} uT, {model.dip / _DEG:.4f} deg below the horizontal")
    lines.append(f"delay of the gyroscope {1e3 * model.gyro_delay:+.4f} ms, of the magnetometer {1e3 * model.mag_delay:+.4f} ms")
    return lines


def _of_triads(model: Any) -> list[str]:
    """Lines with the matrices and biases of an accelerometer and a gyroscope."""
    gyro = _of_triad("gyroscope", model.gyro.matrix, model.gyro.bias, 1 / _DEG, "deg/s")
    return [*_of_triad("accelerometer", model.accel.matrix, model.accel.bias, 1.0, "m/s^2"), *gyro]


def _of_triad(name: str, matrix: Any, bias: Any, factor: float, unit: str) -> list[str]:
    rows = ("  " + "  ".join(f"{c:+.6f}" for c in row) for row in matrix)
    return [f"{name}: bias {', '.join(f'{factor * b:+.5f}' for b in bias)} {unit}; matrix", *rows]


def simulate_north(
    *,
    out: Annotated[Path, checked("--out", lambda path: path.suffix == ".csv", "a name that ends in .csv", "File to write: FILE.csv.")],
    latitude: Annotated[Latitude, Parameter(help="Degrees, north positive.")],
    attitude: Annotated[str, Parameter(help="Roll, pitch and azimuth of the table in degrees.")] = "0,0,0",
    positions: Annotated[
        str, Parameter(help="Table angles in degrees; z and -z for the sensors remounted, z90 at another angle: 0,90,180,270,z,-z.")
    ] = "0,90,180,270",
    dwell: Annotated[
        float, checked("--dwell", lambda dwell: 0 < dwell < math.inf, "a positive number of s", "Time on each position in s.")
    ] = 60.0,
    gyro: Annotated[str, Parameter(help="Noise of the gyro; N, B and K count.")] = "N=0.01deg/sqrt(h)",
    accel: Annotated[str, Parameter(help="Noise of the accelerometer.")] = "N=0.03m/s/sqrt(h)",
    running: Simulating = Simulating(),
) -> None:
    """Simulate a table of turntable readings for `jaxcal north`.

    The biases are 0.5 deg/h and 100 micro-g.
    """
    angles = numbers("--attitude", attitude, "1,2,88")
    if len(angles) != 3:
        raise CallError(f"--attitude {attitude}: expected roll, pitch and azimuth in degrees, such as 1,2,88")
    places = [_position(word.strip()) for word in positions.split(",")]
    noise = noise_from_text(gyro, "gyro"), noise_from_text(accel, "accel")
    with staged([out], force=running.force) as rooms:
        from ..alignment import Positions, Sensor, simulate

        known = Positions([angle * _DEG for _, angle in places], [word for word, _ in places], dwell)
        rate, force = (
            Sensor(0.0, (0.0, 0.0), bias, white=float(one.N), walk=float(one.K), flicker=float(one.B))
            for one, bias in zip(noise, (_GYRO_BIAS * _DEG / 3600, _ACCEL_BIAS * 1e-6 * STANDARD_GRAVITY), strict=True)
        )
        found = simulate(known, [angle * _DEG for angle in angles], latitude * _DEG, accel=force, gyro=rate, seed=running.seed)
        lines = ["angle [deg],mounting,dwell [s],accel [m/s^2],gyro [deg/h]"]
        for (word, angle), a, w in zip(places, found.accel, found.gyro, strict=True):
            lines.append(f"{angle:.10g},{word},{dwell:g},{float(a):.12g},{float(w) / _DEG * 3600:.12g}")
        rooms[out].write_text("\n".join(lines) + "\n", encoding="utf-8")
    screen = Screen(running.quiet)
    roll, pitch, azimuth = angles
    screen.line(f"roll {roll:g}, pitch {pitch:g}, azimuth {azimuth:g} deg")
    screen.line(f"gyro bias {_GYRO_BIAS:g} deg/h, accelerometer bias {_ACCEL_BIAS / 1000:g} mg")
    show_written(screen, [out])


def noise_from_text(text: str, sensor: str) -> Any:
    """Parse coefficients with units, as in ``N=0.25deg/sqrt(h),B=7.6deg/h``, to `Noise`.

    Examples
    --------
    >>> from jaxcal.cli._simulate import noise_from_text
    >>> round(noise_from_text("N=60deg/sqrt(h)", "gyro").N, 6)
    0.017453
    """
    coefficients = {}
    for part in text.split(","):
        found = _TERM.fullmatch(part.strip())
        if found is None:
            raise CallError(f"--{sensor} {text}: {part.strip()!r} is not TERM=VALUE UNIT, with a term of QNBKR, such as N=0.25deg/sqrt(h)")
        term, value, unit = found.groups()
        if term in coefficients:
            raise CallError(f"--{sensor} {text}: {term} is given twice")
        if not unit:
            raise CallError(f"--{sensor} {text}: {term} has no unit; use one of {', '.join(noise_units(term, sensor))}")
        coefficients[term] = float(value) * noise_factor(term, sensor, unit.strip())
    from ..noise import Noise

    return Noise(**coefficients)


def noises(gyro: str | None, accel: str | None) -> dict[str, Any]:
    """Sensor -> `Noise`, for the sensors with a given noise."""
    return {sensor: noise_from_text(text, sensor) for sensor, text in (("gyro", gyro), ("accel", accel)) if text is not None}


def _check_size(rate: float, duration: float) -> None:
    if not 0.0 < rate < float("inf") or not 2.0 <= rate * duration <= _LARGEST:
        raise CallError(f"--rate {rate:g} --duration {duration:g}: expected a log of 2 to {_LARGEST} samples")


def write_log(
    out: Path, truth: dict[str, Any], rate: float, duration: float, running: Simulating,
    bias: dict[str, tuple[float, float, float]] | None = None, folder: Path | None = None,
) -> None:  # fmt: skip
    """Simulate three independent axes of every sensor in `truth`, add the biases and gravity on z, and write the log."""
    _check_size(rate, duration)

    def make(random: Any) -> Made:
        import numpy as np

        samples = round(rate * duration)
        sensors = {}
        for sensor, noise in truth.items():
            axes = [noise.simulate(samples, rate, seed=random) for _ in range(3)]
            sensors[sensor] = np.stack(axes, axis=1) + np.asarray((bias or {}).get(sensor, (0.0, 0.0, 0.0)))
        if "accel" in sensors:
            sensors["accel"][:, 2] += STANDARD_GRAVITY
        return np.arange(samples) / rate, sensors, [] if folder else said

    said = []
    for sensor, noise in truth.items():
        known = {term: float(noise.coefficient(term)) for term in "QNBKR"}
        terms = ", ".join(f"{term} {value:.4g} {noise_units(term, sensor)[-1]}" for term, value in known.items() if value)
        said.append(f"{sensor}, every axis: {terms}")
    _write(out, make, running, folder)


def _write(out: Path, make: Callable[[Any], Made], running: Simulating, folder: Path | None = None) -> None:
    """Write the log that `make` returns for a random generator, and print its truth; of the log in a `folder` the caller says more."""
    with staged([out], folder=folder, force=running.force) as places, progress("simulating", running.quiet):
        import numpy as np

        time, sensors, said = make(np.random.default_rng(running.seed))
        save_log(places[out], time, sensors)
    screen = Screen(running.quiet)
    for line in said:
        screen.line(line)
    show_written(screen, [] if folder else [out])


def save_log(place: Path, time: Any, sensors: dict[str, Any]) -> None:
    """Write a log as CSV or NPZ, in SI units; missing values are NaN."""
    import numpy as np

    if place.suffix == ".npz":
        np.savez(place, time=time, **sensors, units="SI")
        with zipfile.ZipFile(place, "a") as file:
            file.comment = b"written by jaxcal"  # by which the next run knows that it may replace the file
        return
    names = ["time [s]"]
    for sensor, values in sensors.items():
        axes = [f"_{axis}" for axis in "xyz"[: values.shape[1]]] if values.ndim == 2 else [""]
        names += [f"{sensor}{axis} [{si_unit(sensor)}]" for axis in axes]
    table = np.column_stack([time, *sensors.values()])
    np.savetxt(place, table, fmt=["%.9f", *["%.9g"] * (len(names) - 1)], delimiter=",", header=",".join(names), comments="")


def _position(word: str) -> tuple[str, float]:
    for mounting in ("-z", "z"):
        if word.startswith(mounting):
            return mounting, numbers("--positions", word.removeprefix(mounting) or "0", "0,90,z,-z")[0]
    return "x", numbers("--positions", word, "0,90,z,-z")[0]
