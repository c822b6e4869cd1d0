"""Everything known about one device."""

from ._calibration import Calibration as Calibration
from ._noise import DeviceNoise as DeviceNoise, SensorNoise as SensorNoise
