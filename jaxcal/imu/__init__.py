"""Accelerometers and gyroscopes: scale factors, misalignment, bias, g-sensitivity, with a turntable and without one."""

from ._conversions import ArduPilot as ArduPilot, ImuTk as ImuTk, Kalibr as Kalibr, OpenVins as OpenVins, Px4 as Px4
from ._frames import turned_to as turned_to
from ._gravity import gravity as gravity
from ._known import rate_table as rate_table, six_position as six_position
from ._linear import TriadFit as TriadFit
from ._multi import multi_position as multi_position
from ._observe import Observability as Observability, observability as observability
from ._result import ImuFit as ImuFit
from ._simulate import simulate as simulate, simulate_positions as simulate_positions
from ._static import StillIntervals as StillIntervals, static_intervals as static_intervals
from ._triad import Triad as Triad
