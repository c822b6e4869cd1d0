"""`simulate`: a bias that depends on temperature, with a known jump and known hysteresis."""

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray, Numbers
from ._curves import sigmoid
from ._hysteresis import felt

_LOW, _HIGH, _JUMP, _WIDTH, _PERIOD = 20.0, 45.0, 24.5, 0.08, 4500.0


class Simulated(eqx.Module):
    """A simulated record.

    Attributes
    ----------
    time : (n,) s.
    temperature : (n,) readings of the thermometer, with noise, degC.
    bias : (n,) readings of the sensor at rest, with noise and random walk, rad/s.
    true_temperature : (n,) true temperature, degC.
    truth : (n,) bias without noise, rad/s.

    Examples
    --------
    >>> import jaxcal
    >>> made = jaxcal.temperature.simulate(duration=600.0)
    >>> made.time.shape, made.bias.shape
    ((600,), (600,))
    """

    time: AnyArray
    temperature: AnyArray
    bias: AnyArray
    true_temperature: AnyArray
    truth: AnyArray


def reference_bias(temperature: Numbers, jump: float = np.deg2rad(0.3)) -> AnyArray:
    r"""Compute the true bias of `simulate`, rad/s: a cubic between 20 and 45 degC, and a jump at 24.5 degC.

    .. math:: b = 0.05 + 0.12 x - 0.06 x^2 + 0.04 x^3 + J/(1 + e^{-(T - 24.5)/0.08})\ \text{deg/s},\quad x = (T - 32.5)/12.5

    Parameters
    ----------
    temperature : (n,) or (), degC.
    jump : height J of the jump, rad/s.

    Returns
    -------
    Bias in the shape of `temperature`, rad/s.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> low, high = jaxcal.temperature.reference_bias(np.array([24.0, 25.0]))
    >>> round(float(np.rad2deg(high - low)), 2)
    0.32

    References
    ----------
    A stand-in for the channels of the thesis, section 7.1, whose output jumps at 24 to 25 degC.
    """
    t = np.asarray(temperature, dtype=float)
    x = (t - 32.5) / 12.5
    return np.deg2rad(0.05 + 0.12 * x - 0.06 * x**2 + 0.04 * x**3) + jump * sigmoid(t, _JUMP, _WIDTH)


@host_float64
def simulate(
    *, jump: float = np.deg2rad(0.3), profile: str = "ramp", lag: float = 0.0, play: float = 0.0, noise: float = np.deg2rad(4e-3),
    walk: float = np.deg2rad(2e-5), thermometer: float = 0.02, duration: float = 5400.0, rate: float = 1.0,
    seed: int | np.random.Generator = 0,
) -> Simulated:  # fmt: skip
    """Simulate a gyroscope channel at rest while the temperature changes between 20 and 45 degC.

    Parameters
    ----------
    jump : height of the jump at 24.5 degC, rad/s.
    profile : "ramp", once from 20 to 45 degC; "cycle", a sine with a period of 75 minutes that starts upwards at 32.5 degC.
    lag : time constant in s with which the sensor follows the true temperature.
    play : half-width of the sensor's backlash, degC.
    noise : standard deviation of the white noise of a sample, rad/s.
    walk : standard deviation of the random-walk step of the bias from sample to sample, rad/s.
    thermometer : standard deviation of the thermometer's noise, degC.
    duration : s. rate : Hz.
    seed : integer or NumPy generator.

    Returns
    -------
    Simulated
        Record and truth: s, degC and rad/s.

    Raises
    ------
    DataError
        If there are fewer than two samples, or the profile is unknown.

    Examples
    --------
    >>> import jaxcal
    >>> made = jaxcal.temperature.simulate(seed=1)
    >>> made.bias.shape, float(made.true_temperature[0])
    ((5400,), 20.0)

    References
    ----------
    The cases of the thesis, section 7.1, with a jump of known height; lag and play as in `fit`.
    """
    n = round(duration * rate)
    if n < 2 or profile not in ("ramp", "cycle"):
        raise DataError(f'{n} samples of profile {profile!r}; expected at least 2, and "ramp" or "cycle"')
    random = np.random.default_rng(seed)
    time = np.arange(n) / rate
    middle, half = (_HIGH + _LOW) / 2, (_HIGH - _LOW) / 2
    t = np.linspace(_LOW, _HIGH, n) if profile == "ramp" else middle + half * np.sin(2 * np.pi * time / _PERIOD)
    truth = reference_bias(felt(t, lag, play, 1 / rate), jump)
    bias = truth + noise * random.standard_normal(n) + np.cumsum(walk * random.standard_normal(n))
    return Simulated(time, t + thermometer * random.standard_normal(n), bias, t, truth)
