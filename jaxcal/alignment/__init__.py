"""Stationary levelling and north finding with one accelerometer and one gyro on a turntable."""

from ._azimuth import AZIMUTH_METHODS as AZIMUTH_METHODS, Azimuth as Azimuth, azimuth as azimuth
from ._bound import crlb as crlb
from ._carousel import Carousel as Carousel, carousel as carousel
from ._coarse import Coarse as Coarse, coarse as coarse
from ._fit import fit as fit
from ._level import LEVEL_METHODS as LEVEL_METHODS, Level as Level, level as level
from ._model import NAMES as NAMES, UNITS as UNITS, Geometry as Geometry, Turntable as Turntable
from ._plan import Plan as Plan, best_angle as best_angle, plan as plan
from ._positions import Positions as Positions, Readings as Readings, Sensor as Sensor
from ._result import AlignmentFit as AlignmentFit, Bound as Bound
from ._simulate import simulate as simulate
from ._table import Table as Table, residuals as residuals, tabulate as tabulate
from ._verdict import NO_NUMBER as NO_NUMBER, Verdict as Verdict, verdict_name as verdict_name
