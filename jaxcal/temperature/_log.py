"""`characterise`: fit thermal models to every channel of a log."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .._answer import Message
from .._errors import DataError
from .._log import Log, LogLike, as_log
from .._types import AnyArray
from ._findings import FINDINGS
from ._fit import fit
from ._result import TemperatureFits

_SENSORS = ("gyro", "accel", "mag")


def characterise(
    log: LogLike, *, rate: float | None = None, progress: Callable[[int, int, str], None] | None = None, **options: Any
) -> TemperatureFits:
    """Fit a thermal model to every gyroscope, accelerometer and magnetometer channel of a log of a sensor at rest.

    The sensor must keep its attitude. The "bias" of an accelerometer then includes its component of gravity, that of a magnetometer its
    component of the field; only the change with temperature is an error of the sensor.

    Parameters
    ----------
    log : a `Log`, or anything that `jaxcal.read` accepts, with a temperature; a slow thermometer is interpolated.
    rate : sampling rate in Hz, for data without times.
    progress : function called as progress(done, total, channel) before each channel, and once at the end.
    options : options of `fit`: model, degree, lag, play, confidence.

    Returns
    -------
    TemperatureFits
        Channel name (gyro_x .. mag_z) -> `TemperatureFit`.

    Raises
    ------
    DataError
        If the log has no temperature or no sensor channel, or `fit` refuses every channel; the message then names the first. A channel
        that is dead or refused beside others is left out, and a finding says so.

    Examples
    --------
    >>> import jaxcal
    >>> made = jaxcal.temperature.simulate()
    >>> log = jaxcal.Log(made.time, gyro=made.bias, temperature=made.temperature)
    >>> jaxcal.temperature.characterise(log, model="polynomial", degree=3)["gyro_x"].degree
    3
    """
    log = as_log(log, rate)
    channels = {name: values for name, values in log.channels().items() if name.partition("_")[0] in _SENSORS}
    temperature = thermometer(log)
    if not channels:
        raise DataError(Message("the log has no sensor; name columns of gyroscope or others with {option.columns}"), code="no_sensor")
    report = progress or (lambda done, total, name: None)
    fits, dead, refused = {}, [], []
    for done, (name, values) in enumerate(channels.items()):
        report(done, len(channels), name)
        if len(here := values[np.isfinite(values)]) and np.ptp(here) == 0 and len(dead) < len(channels) - 1:
            dead.append(FINDINGS("constant", name))
            continue
        try:
            fits[name] = fit(temperature, values, time=log.time, sensor=name.partition("_")[0], **options)
        except DataError as error:
            refused.append(error.of(name))
            dead.append(FINDINGS("refused", name, why=error))
    if not fits:
        raise refused[0]
    report(len(channels), len(channels), "")
    return TemperatureFits(fits, dead)


def thermometer(log: Log) -> AnyArray:
    """Compute the temperature of a log at every sample: missing values are interpolated, and the result is averaged over a second.

    Parameters
    ----------
    log : `Log` with a temperature.

    Returns
    -------
    (n,) degC, at the times of the log.

    Raises
    ------
    DataError
        If the log has no temperature.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> slow = np.array([20.0, np.nan, np.nan, 23.0])
    >>> log = jaxcal.Log(None, gyro=np.zeros((4, 3)), temperature=slow, rate=1.0)
    >>> jaxcal.temperature.thermometer(log).round(3).tolist()
    [20.0, 21.0, 22.0, 23.0]

    References
    ----------
    Linear interpolation and a running mean. A correction turns the thermometer's noise into noise of the output, in proportion to the
    slope of the bias; the average over a second removes most of it.
    """
    if log.temperature is None:
        raise DataError(Message("no temperature; name its column with {option.columns:temperature=NAME}"), code="no_temperature")
    t = np.asarray(log.temperature, dtype=float)
    known = np.isfinite(t)
    t = np.asarray(np.interp(log.time, log.time[known], t[known]))
    size = max(round(log.rate), 1)
    if size == 1 or len(t) < size:
        return t
    total = np.cumsum(np.append(0.0, t - t[0]))
    first, last = (np.clip(np.arange(len(t)) + by, 0, len(t)) for by in (-(size // 2), size // 2 + 1))
    return t[0] + (total[last] - total[first]) / (last - first)
