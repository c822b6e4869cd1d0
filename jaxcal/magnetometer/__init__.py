"""Magnetometers: hard and soft iron from readings in many attitudes, heading, coverage."""

from ._admission import Admission as Admission
from ._align import Alignment as Alignment, align as align
from ._attitude import body_field as body_field, scenario as scenario
from ._bootstrap import bootstrap as bootstrap
from ._coverage import Coverage as Coverage, coverage as coverage
from ._current import CurrentTerms as CurrentTerms, fit_current as fit_current, motor_terms as motor_terms
from ._earth import earth_field as earth_field
from ._fit import aligned as aligned, fit as fit
from ._heading import heading as heading
from ._heading_error import heading_uncertainty as heading_uncertainty
from ._known import AttitudeFit as AttitudeFit, fit_attitudes as fit_attitudes
from ._model import MagModel as MagModel
from ._moments import MomentFit as MomentFit, Moments as Moments
from ._offset import fit_offset as fit_offset
from ._plan import Plan as Plan, plan as plan, predict as predict
from ._rates import HardIron as HardIron, hard_iron_by_turning as hard_iron_by_turning
from ._residuals import distance_residuals as distance_residuals, radial_residuals as radial_residuals
from ._result import MagFit as MagFit
from ._several import fit_several as fit_several
