"""Accelerometers and gyroscopes: scale factors, misalignment, bias and g-sensitivity, with or without a turntable."""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._estimate import PoseFit as PoseFit, estimate as estimate
    from ._known import TriadFit as TriadFit, rate_table as rate_table, six_position as six_position
    from ._model import Imu as Imu, Triad as Triad, gravity as gravity
    from ._motion import Motion as Motion, motion as motion
    from ._multi import multi_position as multi_position
    from ._nonlinear import Nonlinear as Nonlinear
    from ._observability import observability as observability
    from ._rate_test import RateTest as RateTest, rate_test as rate_test
    from ._residuals import Poses as Poses, Turns as Turns, residuals as residuals, weighted as weighted
    from ._result import ImuFit as ImuFit
    from ._session import ferraris as ferraris
    from ._simulate import MEMS as MEMS, simulate as simulate
    from ._thermal import ThermalTriad as ThermalTriad, over_temperature as over_temperature

install(__name__, {
    "_estimate": "PoseFit estimate", "_known": "TriadFit rate_table six_position", "_model": "Imu Triad gravity",
    "_motion": "Motion motion", "_multi": "multi_position", "_nonlinear": "Nonlinear", "_observability": "observability",
    "_rate_test": "RateTest rate_test", "_residuals": "Poses Turns residuals weighted", "_result": "ImuFit",
    "_session": "ferraris", "_simulate": "MEMS simulate", "_thermal": "ThermalTriad over_temperature",
})  # fmt: skip
