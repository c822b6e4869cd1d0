"""`jaxcal diff`: changes between two calibrations, and their significance."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import jaxcal

from .._files import json_text, write_atomically
from ._options import Plain, checked, must_be_calibration
from ._outputs import staged
from ._screen import Screen, show_written


def diff(
    first: Annotated[Path, Parameter(help="Calibration as JSON, as the other commands write it.")],
    second: Annotated[Path, Parameter(help="Another one of the same device, from another recording.")],
    /,
    *,
    significance: Annotated[
        float,
        checked(
            "--significance",
            lambda chance: 0 < chance < 1,
            "a probability between 0 and 1, such as 0.01",
            "Probability below which a change counts as one.",
        ),
    ] = 0.01,
    json: Annotated[Path | None, Parameter(help="File for the differences, in SI units.")] = None,
    running: Plain = Plain(),
) -> None:
    """Compare two calibrations of one device, with the significance of changes.

    A table for every part that both calibrations have shows the values, their
    difference and its standard error, and the chi-square of all differences.
    """
    must_be_calibration(first, second)
    screen = Screen(running.quiet)
    with staged([json] if json else [], inputs=[first, second], force=running.force) as places:
        parts = jaxcal.calibration.difference(jaxcal.Calibration.load(first), jaxcal.Calibration.load(second))
        if not parts:
            raise jaxcal.DataError(f"{first} and {second} have no part in common that could be compared")
        if json is not None:
            write_atomically(places[json], json_text(_document(parts)))
    for part in parts:
        rows = [
            [name, f"{a:.5g}", f"{b:.5g}", *_change(change, error)]
            for name, a, b, change, error in zip(part.parameters, part.first, part.second, part.change, part.standard_error, strict=True)
        ]
        screen.table(_title(part, significance), ["", "first", "second", "change", "standard\nerror", "ratio"], rows)
        units = {_kind(name): unit for name, unit in zip(part.parameters, part.units, strict=True) if unit != "1"}
        if units:
            screen.line("units: " + "; ".join(f"{name} {unit}" for name, unit in units.items()))
        for note in part.notes:
            screen.line(f"({note})")
    changed = [part.name for part in parts if part.probability < significance]
    screen.line()
    screen.line(f"changed: {', '.join(changed)}" if changed else "no change beyond chance was found in what has a covariance")
    if json is not None:
        show_written(screen, [json])


def _title(part: Any, significance: float) -> str:
    if part.degrees_of_freedom == 0:
        return f"{part.name}: significance not known"
    verdict = "changed" if part.probability < significance else "no change beyond chance"
    return f"{part.name}: {verdict}; chi-square {part.chi_square:.4g} of {part.degrees_of_freedom}, probability {part.probability:.2g}"


def _change(change: float, error: float) -> list[str]:
    if error > 0:
        return [f"{change:.3g}", f"{error:.2g}", f"{change / error:+.1f}"]
    return [f"{change:.3g}", "fixed" if error == 0 else "", ""]


def _kind(name: str) -> str:
    """Name of a parameter without its axes."""
    return name.split("[")[0].split(" at ")[0].removesuffix(" x").removesuffix(" y").removesuffix(" z")


def _document(parts: Any) -> dict[str, Any]:
    """Document for JSON, schema "jaxcal.difference/1"."""
    from .._results import plain

    document = [{**plain(part), "change": plain(part.change)} for part in parts]
    return {"schema": "jaxcal.difference/1", "version": jaxcal.__version__, "parts": document}
