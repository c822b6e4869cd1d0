"""Accelerometers and gyroscopes: scale factors, misalignment, bias and g-sensitivity, with or without a turntable."""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._conversions import ArduPilot as ArduPilot, ImuTk as ImuTk, Kalibr as Kalibr, OpenVins as OpenVins, Px4 as Px4
    from ._estimate import Estimate as Estimate, estimate as estimate
    from ._integrate import attitude as attitude
    from ._known import TriadFit as TriadFit, rate_table as rate_table, six_position as six_position
    from ._model import Imu as Imu, Triad as Triad, gravity as gravity, in_convention as in_convention, turned_to as turned_to
    from ._motion import Motion as Motion, motion as motion
    from ._multi import multi_position as multi_position
    from ._nonlinear import TERMS as TERMS, Nonlinear as Nonlinear, with_terms as with_terms
    from ._rate_test import RateTest as RateTest, ScaleFigures as ScaleFigures, rate_test as rate_test, scale_figures as scale_figures
    from ._rectification import Rectification as Rectification, vibration_rectification as vibration_rectification
    from ._residuals import Poses as Poses, Turns as Turns, Weighted as Weighted, residuals as residuals, weighted as weighted
    from ._rests import StillIntervals as StillIntervals, static_intervals as static_intervals, windowed_variance as windowed_variance
    from ._result import ImuFit as ImuFit, Observability as Observability, observability as observability
    from ._session import faces as faces, ferraris as ferraris, joined as joined, read_regions as read_regions
    from ._simulate import (
        MEMS as MEMS,
        MEMS_NOISE as MEMS_NOISE,
        attitudes as attitudes,
        simulate as simulate,
        simulate_positions as simulate_positions,
    )

install(
    __name__,
    {
        "_conversions": "ArduPilot ImuTk Kalibr OpenVins Px4",
        "_estimate": "Estimate estimate",
        "_integrate": "attitude",
        "_known": "TriadFit rate_table six_position",
        "_model": "Imu Triad gravity in_convention turned_to",
        "_motion": "Motion motion",
        "_multi": "multi_position",
        "_nonlinear": "TERMS Nonlinear with_terms",
        "_rate_test": "RateTest ScaleFigures rate_test scale_figures",
        "_rectification": "Rectification vibration_rectification",
        "_residuals": "Poses Turns Weighted residuals weighted",
        "_rests": "StillIntervals static_intervals windowed_variance",
        "_result": "ImuFit Observability observability",
        "_session": "faces ferraris joined read_regions",
        "_simulate": "MEMS MEMS_NOISE attitudes simulate simulate_positions",
    },
)
