"""Magnetometers: hard and soft iron from readings in many attitudes, heading, coverage."""

from ._aligned import aligned as aligned
from ._attitude import body_field as body_field, scenario as scenario
from ._bootstrap import bootstrap as bootstrap
from ._current import CurrentTerms as CurrentTerms, fit_current as fit_current, motor_terms as motor_terms
from ._design._coverage import Coverage as Coverage, coverage as coverage
from ._design._heading_uncertainty import heading_uncertainty as heading_uncertainty
from ._design._plan import Plan as Plan, plan as plan, predict as predict
from ._earth import earth_field as earth_field
from ._ellipsoid._residuals import residuals as residuals
from ._fit import fit as fit
from ._heading import heading as heading
from ._known_attitudes import AttitudeFit as AttitudeFit, fit_attitudes as fit_attitudes
from ._model import MagModel as MagModel
from ._offset import fit_offset as fit_offset
from ._onboard._gate import Admission as Admission
from ._onboard._moments import MomentFit as MomentFit, Moments as Moments
from ._result import MagFit as MagFit
from ._rotation._align import (
    Accelerometer as Accelerometer,
    Alignment as Alignment,
    Gyroscope as Gyroscope,
    Headings as Headings,
    align as align,
)
from ._rotation._turning import HardIron as HardIron, hard_iron_by_turning as hard_iron_by_turning
from ._several import fit_several as fit_several
