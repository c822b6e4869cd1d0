"""Magnetometers: hard and soft iron from readings in many attitudes, heading, coverage."""

from ._check import Check as Check, check as check
from ._design._coverage import Coverage as Coverage, coverage as coverage
from ._ellipsoid._residuals import residuals as residuals
from ._field import body_field as body_field, earth_field as earth_field, heading as heading, scenario as scenario
from ._fit import fit as fit
from ._guide import Guide as Guide, guide as guide, heading_change as heading_change
from ._model import MagModel as MagModel
from ._onboard import Admission as Admission, MomentFit as MomentFit, Moments as Moments
from ._result import MagFit as MagFit
from ._rotation._align import (
    Accelerometer as Accelerometer,
    Alignment as Alignment,
    Gyroscope as Gyroscope,
    Headings as Headings,
    align as align,
)
from ._rotation._joint import aligned as aligned
from ._rotation._turning import HardIron as HardIron, hard_iron_by_turning as hard_iron_by_turning
from ._uncertainty import (
    Plan as Plan,
    bootstrap as bootstrap,
    heading_uncertainty as heading_uncertainty,
    plan as plan,
    predict as predict,
)
from ._vehicle import (
    AttitudeFit as AttitudeFit,
    CurrentTerms as CurrentTerms,
    fit_attitudes as fit_attitudes,
    fit_current as fit_current,
    fit_offset as fit_offset,
    fit_several as fit_several,
    motor_terms as motor_terms,
)
