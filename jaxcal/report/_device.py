"""A device calibrated from one recording, as sections of a page, and as JSON can say it."""

import importlib.metadata
from typing import Any

import numpy as np

from .._log import Log
from .._results import plain
from .._units import STANDARD_GRAVITY
from ..device import DeviceFit
from ._charts import Chart, Curve, charts
from ._html import Markup, definitions, join, numbers, provenance, recording, scroll, section, table, tag, warnings_of

_MOST = 300  # points of a curve
_DEGREE = np.pi / 180
_MEANING = (
    ("Frame", "The axes are those of the accelerometer: its x axis, and its y axis in their plane. The matrices of gyroscope and "
     "magnetometer contain their rotation to these axes."),
    ("Delay", "How much later than the accelerometer a sensor reports; negative where it is earlier."),
    ("Residual", "What a sensor read less what the calibrated device would have read on the way that fits all sensors best. Noise "
     "scatters about zero with the same width everywhere. A stretch that leaves zero was disturbed, or the model is too simple there."),
    ("Contribution", "How many times larger the standard errors would be without that part of the recording."),
)  # fmt: skip
#: heading, names of the matrix and of the offset, factor and unit of the offset
_SENSORS = (
    ("Accelerometer", "accel.matrix", "accel.bias", 1.0, "m/s²"),
    ("Gyroscope", "gyro.matrix", "gyro.bias", _DEGREE, "deg/s"),
    ("Magnetometer", "magnetometer.soft_iron", "magnetometer.hard_iron", 1.0, ""),
)
