"""Magnetometers: hard and soft iron from readings in many attitudes, heading, coverage."""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._aids import (
        Accelerometer as Accelerometer,
        Alignment as Alignment,
        Attitude as Attitude,
        Gyroscope as Gyroscope,
        Headings as Headings,
    )
    from ._field import (
        Coverage as Coverage,
        body_field as body_field,
        coverage as coverage,
        earth_field as earth_field,
        heading as heading,
        scenario as scenario,
    )
    from ._fit import fit as fit
    from ._judge import heading_uncertainty as heading_uncertainty
    from ._model import MagModel as MagModel, residuals as residuals
    from ._moments import Moments as Moments
    from ._plan import Guide as Guide, Plan as Plan, guide as guide, plan as plan, predict as predict
    from ._result import Check as Check, MagFit as MagFit, check as check
    from ._track import Track as Track, track as track

install(
    __name__,
    {
        "_aids": "Accelerometer Alignment Attitude Gyroscope Headings",
        "_moments": "Moments",
        "_field": "Coverage body_field coverage earth_field heading scenario",
        "_fit": "fit",
        "_judge": "heading_uncertainty",
        "_model": "MagModel residuals",
        "_plan": "Guide Plan guide plan predict",
        "_result": "Check MagFit check",
        "_track": "Track track",
    },
)
