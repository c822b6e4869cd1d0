"""Static levelling and north finding with one accelerometer and one gyro on a turntable."""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._azimuth import Azimuth as Azimuth, azimuth as azimuth
    from ._bound import crlb as crlb
    from ._fit import fit as fit
    from ._level import Level as Level, level as level
    from ._model import Turntable as Turntable, residuals as residuals
    from ._noise import Sensor as Sensor, noise_of as noise_of
    from ._plan import Plan as Plan, plan as plan
    from ._positions import Positions as Positions, Readings as Readings
    from ._readings import simulate as simulate
    from ._result import AlignmentFit as AlignmentFit, Bound as Bound
    from ._tablelog import TableLog as TableLog, from_log as from_log

install(
    __name__,
    {
        "_azimuth": "Azimuth azimuth",
        "_bound": "crlb",
        "_fit": "fit",
        "_level": "Level level",
        "_model": "Turntable residuals",
        "_noise": "Sensor noise_of",
        "_plan": "Plan plan",
        "_positions": "Positions Readings",
        "_readings": "simulate",
        "_result": "AlignmentFit Bound",
        "_tablelog": "TableLog from_log",
    },
)
