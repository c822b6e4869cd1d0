"""`estimate`: fit both triads and their covariance to poses and turns, as a pure function."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._compile import filter_jit
from .._precision import array_module, host_float64
from .._types import AnyArray, Scalar
from ..fitting import AbstractLoss, AbstractPrior, Estimate, Fit, covariance, solve
from ._model import Imu, Triad, checked_convention, entries, freed, in_convention, replaced, values
from ._residuals import Poses, Turns, Weighted, arrays, residuals, reweighted

#: a fit ends when the remaining step is below this share of the statistical uncertainty
RTOL = 1e-4


class PoseFit(eqx.Module):
    """Sensors fitted to poses and turns.

    Attributes
    ----------
    model : `Imu` with the fitted sensors.
    estimate : `jaxcal.fitting.Estimate` of the parameters of both sensors, in units of the readings per SI; the covariance is infinite if
        the data do not determine every parameter.
    fit : `jaxcal.fitting.Fit`, in the frame of the fit.
    data : the `Weighted` data of the fit.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Poses, estimate
    >>> up = np.random.default_rng(0).normal(size=(18, 3))
    >>> up = 9.81 * up / np.linalg.norm(up, axis=1, keepdims=True)
    >>> found = estimate(Poses(1.01 * up, np.full(18, 2e-3)), gravity=9.81)
    >>> found.estimate.names[:2], round(float(found.model.accel.matrix[0, 0]), 4)
    (('accel.matrix[0,0]', 'accel.matrix[0,1]'), 1.01)
    """

    model: Imu
    estimate: Estimate
    fit: Fit[Any]
    data: Weighted


@host_float64
def estimate(
    poses: Poses, turns: Turns | None = None, *, gravity: Scalar | int, model: Triad | Imu | None = None, convention: str = "upper",
    misalignment: bool = True, g_sensitivity: bool = True, latitude: Scalar | int | None = None, loss: AbstractLoss | None = None,
) -> PoseFit:  # fmt: skip
    r"""Fit accelerometer and gyroscope to the means of still poses and the samples of the turns between them.

    The fit minimises the sum of squares of `residuals`, or their loss. The covariance is :math:`s^2 (J^T J)^{-1}` with the reduced
    chi-square s^2.

    To start from a recording, use `multi_position`, which also finds poses, turns and standard deviations, and judges the result. This
    function runs under jit, vmap and grad: you can differentiate the result by readings, standard deviations, gravity and latitude.

    Parameters
    ----------
    poses : `Poses`, 9 or more attitudes in general position.
    turns : `Turns` between the poses; None fits the accelerometer alone.
    gravity : m/s^2.
    model : initial model, which also defines the parameters: a `Triad` or a subclass for the accelerometer, or an `Imu` with both
        sensors. Every floating-point field is a parameter; those that the convention fixes keep their value. None is the unit triad.
    convention : "upper", "lower" or "full", the frame of the result, see `turned_to`. A subclass of `Triad` is fitted in "upper" or
        "lower": the entries of its accelerometer's matrix on the other side of the diagonal stay fixed.
    misalignment : whether to fit the off-diagonal entries of the accelerometer's matrix.
    g_sensitivity : whether to fit the gyroscope's sensitivity to specific force.
    latitude : rad, to account for the Earth's rate; None leaves it out.
    loss : a loss of `jaxcal.fitting`, such as `Huber()`; None uses least squares.

    Returns
    -------
    PoseFit

    Raises
    ------
    DataError
        If the convention is unknown, or is "full" with a subclass of `Triad`.

    Examples
    --------
    Eighteen poses of an accelerometer, with noise of 2 mm/s^2:

    >>> import numpy as np
    >>> from jaxcal.imu import MEMS, Poses, estimate
    >>> rng = np.random.default_rng(0)
    >>> up = rng.normal(size=(18, 3))
    >>> force = 9.81 * up / np.linalg.norm(up, axis=1, keepdims=True)
    >>> readings = MEMS.accel.measure(force) + 2e-3 * rng.normal(size=(18, 3))
    >>> found = estimate(Poses(readings, np.full(18, 2e-3)), gravity=9.81)
    >>> print(found.model.accel.bias.round(2), bool(np.all(found.estimate.select("accel.bias*").error < 3e-3)))
    [ 0.12 -0.08  0.2 ] True

    References
    ----------
    D. Tedaldi, A. Pretto and E. Menegatti, ICRA 2014; the thesis, equations (5.1) to (5.5).
    """
    start = started(model, turns is not None, latitude is not None)
    checked_convention(convention, start.plain)
    start, data = arrays((start, Weighted(poses, turns, gravity, latitude)))
    data = reweighted(start, data)
    # iterate to full convergence (rtol=None), so that differences of two estimates agree with the derivatives
    return described(solved(start, data, convention, misalignment, g_sensitivity, loss, rtol=None), data, convention)


def solved(
    start: Imu, data: Weighted, convention: str = "upper", misalignment: bool = True, g_sensitivity: bool = True,
    loss: AbstractLoss | None = None, rtol: float | None = RTOL, priors: Sequence[AbstractPrior] = (),
) -> Fit:  # fmt: skip
    """Fit weighted data. Plain triads are always fitted in the frame "upper"; `framed` rotates them afterwards."""
    free = freed(start, "upper" if start.plain else convention, misalignment, g_sensitivity)
    return solve(residuals, start, data, free=free, loss=loss, rtol=rtol, priors=priors)


def described(fit: Fit[Any], data: Weighted, convention: str) -> PoseFit:
    """Convert a fit to a `PoseFit` in the frame of a convention."""
    names = entries(fit.model)[0]
    found, (matrix,) = framed(fit.model, convention, placed(fit.names, covariance(fit, scaled=True), names))
    made = Estimate(names, values(found), matrix, np.inf, states_of(names, fit.names, convention if fit.model.plain else "upper"))
    return PoseFit(found, made, eqx.tree_at(lambda f: f.problem, fit, None, is_leaf=lambda x: x is None), data)


def states_of(names: Iterable[str], fitted: Iterable[str], convention: str) -> dict[str, str]:
    """State of the parameters that were not fitted; `convention` is the frame into which the fit was turned from "upper"."""
    fixed = set(names) - set(fitted)
    aside = {f"accel.matrix[{i},{j}]": f"accel.matrix[{j},{i}]" for i in range(3) for j in range(3)}
    if convention == "lower":  # the other triangle
        fixed = {aside.get(name, name) for name in fixed}
    if convention == "full":  # a symmetric matrix, of which no entry is zero unless the model is diagonal
        fixed = {name for name in fixed if aside.get(name, name) in fixed}
    return dict.fromkeys(fixed, "held")


def started(model: Any, gyro: bool, north: bool) -> Imu:
    """Initial model, with a gyroscope if `gyro`, and with the heading of the first pose if `north`."""
    unit = Triad(np.eye(3), np.zeros(3))
    whole = model if isinstance(model, Imu) else Imu(unit if model is None else model)
    second = (unit if whole.gyro is None else whole.gyro) if gyro else None
    return dataclasses.replace(whole, gyro=second, north=np.zeros(2) if north else None)


def placed(fitted: tuple[str, ...], matrix: AnyArray, names: tuple[str, ...]) -> AnyArray:
    """Expand the covariance of the fitted parameters to all `names`, with zeros for fixed parameters."""
    xp = array_module(matrix)
    place = np.array([fitted.index(name) if name in fitted else len(fitted) for name in names])
    return xp.pad(xp.asarray(matrix), ((0, 1), (0, 1)))[place][:, place]


@filter_jit
def _turned(model: Imu, convention: str) -> tuple[Imu, AnyArray]:
    turned = in_convention(model, convention)
    return turned, jax.jacfwd(lambda x: values(in_convention(replaced(model, x), convention)))(values(model))


def turned(model: Imu, convention: str, *matrices: AnyArray) -> tuple[Imu, list[AnyArray]]:
    """Transform a model and covariances of its parameters to the frame of a convention."""
    found, slope = _turned(model, convention)
    return found, [slope @ matrix @ slope.T for matrix in matrices]


def framed(model: Imu, convention: str, *matrices: AnyArray) -> tuple[Imu, list[AnyArray]]:
    """Like `turned`, for a model directly after its fit, which is already in the frame "upper"."""
    if convention == "upper" or not model.plain:
        return model, list(matrices)
    return turned(model, convention, *matrices)
