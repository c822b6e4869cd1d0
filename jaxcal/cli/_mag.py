"""`jaxcal mag`: hard and soft iron of a magnetometer from a log of it in many attitudes."""

import datetime
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from ._cache import keep_compiled
from ._export import FILES
from ._options import WRITING, CallError, Reading, Running, distinct, read_log, stem
from ._outputs import Maker, Outputs, exports, outputs, save_json, save_picture, save_report, staged
from ._screen import Screen, progress, show_log, show_written

Method = Literal["ml", "consistent", "algebraic", "li_griffiths", "constrained", "radial", "axes", "minmax"]
Model = Literal["auto", "sphere", "diagonal", "symmetric", "planar"]
_MICRO = 1e-6
#: format of --export -> name of the file where none is given
_EXPORTS = {name: FILES[name] for name in ("motioncal", "c", "csv")}


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class Writing:
    """Where results go. Without any of these, into the folder LOG-mag, all but the corrected log.

    Attributes
    ----------
    out
        Folder for the files, made if it is missing.
    json
        Calibration, uncertainty and verdict as JSON, in SI units.
    report
        Report as one HTML file.
    calibration
        Calibration of the device as JSON, for jaxcal.Calibration.load.
    corrected
        Corrected log: FILE.csv or FILE.npz.
    export
        File for another tool: motioncal, c, csv, or such as c=FILE. Repeatable; jaxcal export writes the other formats.
    """

    out: Path | None = None
    json: Path | None = None
    report: Path | None = None
    calibration: Path | None = None
    corrected: Path | None = None
    export: Annotated[tuple[str, ...] | None, Parameter(name="--export")] = None


def mag(
    log: Path,
    /,
    *,
    method: Method = "ml",
    model: Model = "auto",
    field: float | None = None,
    inclination: float | None = None,
    field_error: float | None = None,
    place: tuple[float, float] | None = None,
    date: str | None = None,
    loss: Literal["none", "huber", "cauchy", "tukey"] = "none",
    penalty: float = 0.5,
    align: Literal["none", "accel", "gyro"] = "none",
    joint: bool = False,
    force: bool = False,
    reading: Reading = Reading(),
    writing: Writing = Writing(),
    running: Running = Running(),
) -> None:
    """Hard and soft iron of a magnetometer that was turned through all attitudes.

    With their uncertainty, the heading error to expect, the directions that
    are still missing, and a verdict. A refused fit ends with status 1.

    Parameters
    ----------
    log
        The log: CSV, NPZ, Parquet, ROS bag.
    method
        How to fit; ml is the maximum likelihood, the others are for comparison.
    model
        What to fit: sphere (hard iron), diagonal, symmetric (soft iron), or planar for turns about one axis.
    field
        Norm of Earth's field there, in uT; by default the size of the readings stays.
    field_error
        Relative standard deviation of that norm in the log's unit, such as 0.02: the fit then uses it.
    inclination
        Dip of the field in degrees, for the heading error; by default 57.
    place
        Latitude and longitude in degrees: field and dip by the World Magnetic Model.
    date
        Day of the log for --place, as 2026-05-31.
    loss
        Robust loss for logs with outliers.
    penalty
        Weight of what keeps fits of few readings from running off; 0 for none.
    align
        Find the rotation that norms cannot see, from poses at rest (accel) or from rates (gyro).
    joint
        Fit norms and the sensor of --align together; with little tilt far better than one after the other.
    force
        Write a refused fit too, to look at.
    """
    plan, folder = _outputs(log, writing)
    screen = Screen(running.quiet)
    if joint and (align == "none" or method != "ml" or model not in ("auto", "symmetric") or loss != "none"):
        raise CallError("--joint goes with --align accel or gyro, and with the full soft iron by --method ml without --loss")
    earth = _earth(field, inclination, place, date)
    with staged(plan, inputs=[log], folder=folder) as places:
        with progress(f"reading {log.name}", running.quiet):
            options = {
                "method": method, "model": model, "field": field, "inclination": inclination, "place": place, "date": date, "loss": loss,
                "penalty": penalty, "align": align, "field_error": field_error, "joint": joint,
            }  # fmt: skip
            from ._provenance import signed

            recording = signed(read_log(log, reading), "jaxcal mag", reading, options)
        show_log(screen, recording)
        with progress("fitting", running.quiet):
            keep_compiled()
            chosen = {
                "method": method, "model": model, "field": earth, "field_error": field_error, "penalty": penalty,
                "inclination": None if inclination is None else math.radians(inclination), "loss": None if loss == "none" else loss,
            }  # fmt: skip
            found = _fit(recording, align, joint, chosen)
            _show(screen, found)
            if found.verdict == "refused" and not force:
                import jaxcal

                raise jaxcal.DataError(f"the calibration is refused, and nothing was written (--force writes it). {found.reason}")
            said = [sentence for target, make in plan.items() for sentence in make(places[target], found, recording)]
        written = [target for target, place in places.items() if place.exists()]
    screen.sentences("Warnings", [*recording.warnings, *found.warnings, *said])
    show_written(screen, written)


def _earth(field: float | None, inclination: float | None, place: tuple[float, float] | None, date: str | None) -> Any:
    """Norm of the field in tesla, its vector, or None."""
    if field is not None and not 0 < field < 1000:
        raise CallError(f"--field {field:g}: expected the norm of the field in uT, 22 to 67 on Earth")
    if inclination is not None and not abs(inclination) < 90:
        raise CallError(f"--inclination {inclination:g}: expected degrees between -90 and 90, positive downwards")
    if (place is None) != (date is None):
        raise CallError("--place and --date go together: --place 39.93 32.86 --date 2026-05-31")
    if place is None or date is None:
        return None if field is None else field * _MICRO
    if field is not None:
        raise CallError("--field and --place exclude one another: the place gives the field")
    import jaxcal

    try:
        return jaxcal.magnetometer.earth_field(*place, datetime.date.fromisoformat(date))
    except (ValueError, jaxcal.DataError) as error:  # nothing was read yet
        raise CallError(f"--place {place[0]:g} {place[1]:g} --date {date}: {error}") from error


def _fit(log: Any, align: str, joint: bool, options: dict[str, Any]) -> Any:
    import numpy as np

    import jaxcal

    if log.mag is None or log.mag.shape[1] != 3:
        raise jaxcal.DataError("the log has no magnetometer of three axes; name its columns with --columns mag=mx,my,mz")
    if align != "none" and getattr(log, align) is None:
        raise jaxcal.DataError(f"--align {align}: the log has no {align}; name its columns with --columns {align}=...")
    kept = np.isfinite(log.mag).all(axis=1)
    found = jaxcal.magnetometer.fit(log.mag[kept], **options)
    if align == "none" or found.model is None:
        return found
    from ..magnetometer import Accelerometer, Gyroscope, aligned

    aid = Accelerometer(log.accel) if align == "accel" else Gyroscope(log.gyro, log.rate)
    return aligned(found, log.mag, aid, joint=joint)


def _show(screen: Screen, found: Any) -> None:
    import numpy as np

    screen.line()
    screen.line(f"{found.verdict}: {found.reason}")
    if found.model is None:
        return
    hard, spread = np.asarray(found.model.hard_iron) / _MICRO, found.hard_iron_error / _MICRO
    rows = [
        ["hard iron (uT)", *(f"{b:.4f} +- {s:.2g}" if np.isfinite(s) else f"{b:.4f} open" for b, s in zip(hard, spread, strict=True))],
        *(
            [f"soft iron, {axis}", *(f"{c:.5f}" for c in row)]
            for axis, row in zip("xyz", np.asarray(found.model.soft_iron), strict=True)
        ),
    ]  # fmt: skip
    screen.table(f"magnetometer, model {found.kind}", ["", "x", "y", "z"], rows)
    level, tilted = np.rad2deg(found.heading_error)
    facts = [
        f"heading error to expect: {level:.2g} deg rms" + (f", {tilted:.2g} deg at 20 deg of tilt" if np.isfinite(tilted) else ""),
        f"field {found.field / _MICRO:.5g} uT, noise of a reading {found.noise / _MICRO:.3g} uT an axis",
        f"{len(found.residual)} readings, {len(found.outliers)} of them outliers; {100 * found.coverage.occupied:.0f} % of 500 directions "
        f"seen, largest gap {np.rad2deg(found.coverage.largest_gap):.0f} deg",
    ]
    if len(found.needed) and found.verdict != "good":
        ways = "; ".join("(" + ", ".join(f"{x:+.1f}" for x in way) + ")" for way in np.asarray(found.needed))
        facts.append(f"further readings would help most where the field points along {ways} in sensor axes")
    screen.sentences("Known", facts)


def _outputs(path: Path, writing: Writing) -> Outputs:
    if writing.corrected is not None and writing.corrected.suffix not in (".csv", ".npz"):
        raise CallError(f"--corrected {writing.corrected}: expected a name that ends in .csv or .npz")
    names: dict[str, Maker] = {
        "sphere.png": _sphere, "coverage.png": partial(save_picture, draw="coverage"),
        "heading_error.png": partial(save_picture, draw="heading_error"), "report.html": save_report, "mag.json": save_json,
        "calibration.json": _calibration,
    }  # fmt: skip
    asked = [
        (writing.json, save_json), (writing.report, save_report), (writing.calibration, _calibration),
        *exports(writing.export, _EXPORTS, _export, writing.out),
    ]  # fmt: skip
    if writing.corrected is None:
        return outputs(asked, names, out=writing.out, default=f"{stem(path)}-mag")
    # a folder that was named is filled beside it
    plan, folder = outputs(asked, None if writing.out is None else names, out=writing.out)
    return distinct([*plan.items(), (writing.corrected, _corrected)]), folder


def _sphere(place: Path, found: Any, log: Any) -> Sequence[str]:
    import numpy as np

    import jaxcal

    jaxcal.plot.save(jaxcal.plot.sphere(log.mag[np.isfinite(log.mag).all(axis=1)], found)[0], place)
    return ()


def _export(place: Path, found: Any, log: Any, format: str) -> Sequence[str]:
    import jaxcal

    return [f"{place.name}: {sentence}" for sentence in jaxcal.export.write(_device(found, log), place, format=format)]


def _calibration(place: Path, found: Any, log: Any) -> Sequence[str]:
    import jaxcal

    try:
        _device(found, log).save(place)
    except jaxcal.DataError as error:
        return (f"{place.name} is not written: {error}",)
    return ()


def _corrected(place: Path, found: Any, log: Any) -> Sequence[str]:
    from ._simulate import save_log

    fixed = _device(found, log).correct(log)
    names = ("gyro", "accel", "mag")
    save_log(place, fixed.time, {name: getattr(fixed, name) for name in names if getattr(fixed, name) is not None})
    return ()


def _device(found: Any, log: Any) -> Any:
    import jaxcal

    return jaxcal.Calibration(magnetometer=found, provenance=log.provenance)
