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
    from ._check import Check as Check, check as check
    from ._directions import Coverage as Coverage, coverage as coverage
    from ._field import body_field as body_field, earth_field as earth_field, heading as heading, scenario as scenario
    from ._fit import fit as fit
    from ._guide import Guide as Guide, guide as guide
    from ._model import MagModel as MagModel
    from ._moments import Moments as Moments
    from ._own_model import residuals as residuals
    from ._result import MagFit as MagFit
    from ._track import Track as Track, track as track
    from ._uncertainty import Plan as Plan, heading_uncertainty as heading_uncertainty, plan as plan, predict as predict

install(
    __name__,
    {
        "_aids": "Accelerometer Alignment Attitude Gyroscope Headings",
        "_check": "Check check",
        "_directions": "Coverage coverage",
        "_moments": "Moments",
        "_own_model": "residuals",
        "_field": "body_field earth_field heading scenario",
        "_fit": "fit",
        "_guide": "Guide guide",
        "_model": "MagModel",
        "_result": "MagFit",
        "_track": "Track track",
        "_uncertainty": "Plan heading_uncertainty plan predict",
    },
)
