"""`jaxcal diff`: changes between two calibrations, and their significance."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import jaxcal

from .._answer import tables, things_to_know
from ._options import Running, checked, must_be_calibration
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
    running: Running = Running(),
) -> None:
    """Compare two calibrations of one device, with the significance of changes.

    A table for every part that both calibrations have shows the values, their
    difference with its 95 % interval, and the chi-square of all differences.
    """
    must_be_calibration(first, second)
    screen = Screen(running.quiet)
    with staged([json] if json else [], inputs=[first, second], force=running.force) as places:
        found = jaxcal.calibration.difference(*map(jaxcal.Calibration.load, (first, second)), significance=significance)
        if not found.parts:
            raise jaxcal.DataError(f"{first} and {second} have no part in common that could be compared", code="nothing_shared")
        if json is not None:
            found.save(places[json])
    screen.lines(tables("", found.headline, found.sections(), (), **running.how))
    screen.lines(things_to_know(found.findings, more="-v", **running.how))
    show_written(screen, [json] if json else [])
