"""`fit`: joint estimate of attitude, sensor errors and latitude from all readings."""

import dataclasses
from collections.abc import Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.special
import numpy as np

from .._errors import DataError
from .._precision import array_module, host_float64, is_traced
from .._special import chi_square_tail
from .._types import AnyArray, NoiseLike, Real
from ..fitting import Estimate, Fit, solve
from ..noise import Noise
from ._closed import WEAK
from ._findings import FINDINGS, OUTCOMES, decided, findings_of, has_number
from ._lack import checked
from ._model import ANGLES, Table, Triads, Turntable, names_of, padded, residuals, tabulate, with_angle_errors, with_values
from ._noise import SENSORS, check_noise, covariance_of, noise_of
from ._plausible import check_readings
from ._positions import GRAVITY, POLE, SMALL, Readings, check_gravity, check_latitude, wrap
from ._result import QUANTITIES, AlignmentFit, know, sizes_of
from ._start import NEEDED, check_names, free_of, initial_guess, priors_of

#: noise that weights the sensors relative to each other if none is given: 50 micro-g sqrt(s), 0.01 deg/sqrt(h)
_NOMINAL = {"accel": 50e-6 * GRAVITY, "gyro": np.deg2rad(0.01) / 60}
(_MISFIT,) = FINDINGS["misfit"].limits
_ROUNDS = 3  # of fits: noise and weights then change by less than their uncertainty
#: least degrees of freedom to estimate the noise level of a sensor
_FEWEST = 0.5


@host_float64
def fit(
    readings: Readings,
    latitude: Real | None = None,
    *,
    free: Iterable[str] | None = None,
    priors: dict[str, Any] | None = None,
    start: dict[str, Any] | None = None,
    model: Turntable | None = None,
    hint: Real | None = None,
    hemisphere: str | None = None,
    gravity: Real = GRAVITY,
    noise: NoiseLike | None = None,
) -> AlignmentFit:
    r"""Fit roll, pitch, azimuth, sensor errors and, optionally, latitude by joint nonlinear least squares.

    .. math:: \min\ (a - \hat a)^T C_a^{-1} (a - \hat a) + (w - \hat w)^T C_g^{-1} (w - \hat w)
        + \sum_j \frac{(x_j - x_{j0})^2}{\sigma_j^2}

    The fit accepts any positions and mountings, and its accuracy reaches the Cramer-Rao bound. C is the exact covariance of the means over
    the dwells from all terms of the noise (`jaxcal.noise.mean_covariance`); for white noise its diagonal is N^2/T. Errors of the table
    angles (`Positions.angle_std`) correlate the two sensors. A fitted bias is the mean bias over the measured time.

    The fit looks for a drift of the gyro's bias and for a tilting base. It includes what the readings show, and otherwise its errors allow
    for what they do not exclude; an order of positions in which a drift cancels keeps them small. A drift that you name in `free`, `priors`
    or `start` turns this off: ``start={"b_g_rate": 0.0}`` says that nothing drifts. The errors also allow for errors of the table's angles
    that the readings do not exclude, unless `Positions.angle_std` gives their size (0 for exact angles). Without a given noise, the noise
    of the residuals takes the place of the look for a drift and a tilt.

    Parameters
    ----------
    readings : accelerometer or gyro readings or both, with their noise. Without noise, the residuals give a white-noise level for each
        sensor, the intervals use Student's t with the remaining degrees of freedom, and there is no test of fit.
    latitude : rad, north positive; None estimates it.
    free : names of fields of `model`. The default is the angles and biases, and the scale errors if there
        is a z reading. Parameters with a prior are also free.
    priors : name -> standard deviation about zero, or (mean, standard deviation), SI; angles need the mean.
    start : name -> value, SI: initial value of a free parameter, or fixed value of another one (default zero).
    model : model that predicts the readings: a `Turntable` or a subclass; parameters that are not free keep the values of this model.
    hint : rough azimuth, rad, to choose between two solutions.
    hemisphere : "north" or "south", if the latitude is estimated without z readings.
    gravity : local gravity, m/s^2.
    noise : noise of the device for `noise_of` (its x axis; all three for `Triads`), instead of that of the readings.

    Returns
    -------
    AlignmentFit
        Estimate, chi-square test and findings. A traced result has numbers only, no findings; you can differentiate
        it by readings, table angles, latitude, gravity, priors, fixed values and noise.

    Raises
    ------
    DataError
        If a name is unknown, or readings of a required sensor are missing.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Sensor, fit, simulate
    >>> angles = np.deg2rad([0.0, 90.0, 180.0, 270.0])
    >>> gyro, accel = Sensor(bias=5e-8, white=1e-8), Sensor(bias=1e-3, white=1e-6)
    >>> readings = simulate(angles, np.deg2rad([2.0, -1.0, 40.0]), 0.6, accel=accel, gyro=gyro)
    >>> found = fit(readings, 0.6)
    >>> print(np.rad2deg(found.psi).round(1), np.rad2deg(found.azimuth_std).round(3))
    40.0 0.019

    References
    ----------
    The whole model of the north-finding paper, equations (16) to (39) in corrected form, solved jointly.
    """
    check_gravity(gravity)
    if latitude is not None:
        check_latitude(latitude)
    sensors = [name for name in SENSORS if getattr(readings, name) is not None]
    if not sensors:
        raise DataError("There are neither accelerometer nor gyro readings; give at least one of them.", code="no_sensor")
    if hemisphere not in (None, "north", "south"):
        raise DataError(f"The hemisphere is {hemisphere!r}; expected 'north' or 'south'.", code="hemisphere")
    model = Turntable() if model is None else model
    names = names_of(model)
    chosen = free_of(free, priors, readings.positions, latitude, ("accel" in sensors, "gyro" in sensors), names)
    mean, certainty = priors_of(priors, names)
    check_names(start or {}, "parameter for a start", names)
    given = dict(start or {})
    if latitude is not None or "latitude" in mean:
        given["latitude"] = mean["latitude"] if latitude is None else latitude

    values = dict(zip(names, jax.tree.leaves(model), strict=True)) | given
    if noise is not None:
        told = noise_of(noise, None if isinstance(model, Triads) else "x")
        readings = dataclasses.replace(readings, **{name: one for name, one in told.items() if one is not None})
    check_readings(readings)
    side = {None: 0.0, "north": 1.0, "south": -1.0}[hemisphere]
    options = _Options(model, names, tuple(name in chosen for name in names), values, set(given), mean, certainty, hint, side)
    found, table, noise, spare = _joint(readings, gravity, options)
    if table is None:  # traced
        return found
    told = not {"b_g_rate", "b_a_rate"}.isdisjoint(options.chosen | options.known)

    def refit(readings: Readings, begin: dict[str, Any]) -> AlignmentFit:
        return _joint(readings, gravity, dataclasses.replace(options, values=values | begin, known=options.known | set(begin)))[0]

    return checked(found, table, gravity, noise, None if told else spare, refit)


class _Options(eqx.Module):
    """Options of the caller: the model, its parameters by name, and prior knowledge of them."""

    model: Turntable
    names: tuple[str, ...] = eqx.field(static=True)
    free: tuple[bool, ...] = eqx.field(static=True)
    values: dict[str, Any]
    known: set[str] = eqx.field(static=True)
    mean: dict[str, Any]
    certainty: dict[str, Any]
    hint: Any
    hemisphere: float

    @property
    def chosen(self) -> set[str]:
        """Names of the parameters to estimate."""
        return {name for name, free in zip(self.names, self.free, strict=True) if free}


def _joint(readings: Readings, gravity: Any, o: _Options) -> tuple[AlignmentFit, Any, dict[str, Any], dict[str, float]]:
    """Fit with the noise of the readings, or that of their residuals; a traced fit has no table."""
    sensors = [name for name in SENSORS if getattr(readings, name) is not None]
    known = {name: getattr(readings, f"{name}_noise") for name in SENSORS}
    for name in sensors:
        check_noise(known[name], f"{SENSORS[name]} noise")
    unknown = [name for name in sensors if known[name] is None]
    noise = {name: Noise(N=_NOMINAL[name]) if one is None else one for name, one in known.items()}
    traced = is_traced(readings, gravity, o)
    for _ in range(_ROUNDS if unknown and not traced else 1):
        solved, table, twofold = _solved(readings, gravity, noise, o)
        found = _described(solved, table, readings, sizes_of(o.names, gravity, readings.positions), twofold, not unknown, o)
        if traced:
            return found, None, noise, {}
        each = np.stack(_spare(solved, table, np.where(np.isfinite(found.covariance), found.covariance, 0)), axis=1).tolist()
        spare = {name: free for name, (free, _) in zip(SENSORS, each, strict=True) if free > _FEWEST}
        # the noise that the residuals have
        ratio = {name: max((each[i][1] / spare[name]) ** 0.5, 1e-6) for i, name in enumerate(SENSORS) if name in spare}
        noise |= {name: Noise(N=noise[name].N * ratio.get(name, 1.0)) for name in unknown}
    estimated = {name: spare[name] for name in unknown if name in spare}
    freedom = _freedom(solved, table, found, estimated)
    told = _told(found, freedom, readings, o, bool(twofold), [name for name in unknown if name not in estimated])
    return told, table, noise, spare


def _solved(readings: Readings, gravity: Any, noise: dict[str, Any], o: _Options) -> tuple[Fit, Table, Any]:
    """Fit; return the fit, its data, and whether a second set of parameters fits equally well."""
    table = tabulate(readings, gravity, list(noise.values()))
    xp, dtype, chosen = array_module(table, o), table.readings.dtype, o.chosen
    places = padded(readings.positions)
    level = _level(noise["gyro"], places, table.measured[1])
    # the solution does not depend on the start of a free parameter, so only fixed parameters keep their derivative
    still = jax.lax.stop_gradient if xp is jnp else lambda tree: tree
    data, dwell, values, hint, level = still((table, places.dwell, o.values, o.hint, level))
    first, twofold = initial_guess(data, dwell, values, o.known, chosen, hint, level, o.hemisphere)
    first |= {name: value for name, value in o.values.items() if name not in chosen}
    # shift the prior of an angle by whole turns to be nearest to the start of the fit
    near = {name: first[name] + wrap(centre - first[name]) if name in ANGLES else centre for name, centre in o.mean.items()}
    prior, certainty = (xp.stack([xp.asarray(given.get(name, 0.0), dtype=dtype) for name in o.names]) for given in (near, o.certainty))
    table = dataclasses.replace(table, prior=prior, certainty=certainty)
    # a fixed parameter has equal bounds, so that one compiled program serves every choice of free parameters and keeps its derivative
    low, high = ([end if name in chosen else first[name] for name in o.names] for end in (-np.inf, np.inf))
    guess = with_values(o.model, [xp.asarray(first[name], dtype=dtype) for name in o.names])
    bounds = with_values(o.model, low), with_values(o.model, high)
    # iterate, because errors of the table angles act through the slope of the readings, which depends on the solution
    for _ in range(_ROUNDS if readings.positions.doubtful else 1):
        table = with_angle_errors(table, guess, readings.positions, gravity, readings.lever_arm)
        found = solve(residuals, guess, table, bounds=bounds, rtol=SMALL)
        guess = jax.tree.map(jax.lax.stop_gradient, found.model) if xp is jnp else jax.tree.map(np.asarray, found.model)
    found = dataclasses.replace(found, problem=None)
    return found if xp is jnp else jax.tree.map(np.asarray, found), table, twofold


def _described(found: Fit, table: Table, readings: Readings, sizes: Any, twofold: Any, noise_known: bool, o: _Options) -> AlignmentFit:
    """Covariance, test of fit and verdict; in NumPy, which needs no compilation, unless the call is traced."""
    xp = array_module(found, table)
    r, jacobian, n, free, names = found.residuals, found.jacobian, table.readings.shape[1], np.array(o.free), o.names
    known_of = know(jacobian, 2 * n, free, sizes)
    finite = xp.where(xp.isfinite(known_of.covariance), known_of.covariance, 0)
    counted = xp.concatenate([table.measured.reshape(-1), table.certainty > 0])
    dof = xp.sum(counted) - known_of.rank_with_priors
    chi_square = xp.sum(r**2)
    # on the host without SciPy's special functions, which are slow to load
    tail = chi_square_tail if xp is np else lambda square, freedom: jax.scipy.special.gammaincc(freedom / 2, square / 2)
    # each sensor alone, too: errors of the table's angles are often seen by one of them
    spare, square = _spare(found, table, finite)
    freedom = xp.round(xp.concatenate([xp.asarray(dof, dtype=spare.dtype)[None], spare]))
    levels: Any = tail(xp.concatenate([chi_square[None], square]), xp.maximum(freedom, 1))
    p_value, alone = levels[0], [xp.where(left > _FEWEST, level, 1.0) for left, level in zip(spare, levels[1:], strict=True)]
    # the solver's own convergence test fails for noise-free readings, whose residuals are rounding, and along undetermined directions: a
    # fit has converged, too, where the remaining step is a thousandth of the standard error
    gradient = jacobian.T @ r
    usable = xp.asarray(found.usable) | (gradient @ finite @ gradient < SMALL)
    # damped steps end early along directions that are hardly determined, so finish with an undamped Gauss-Newton step
    last = xp.where(usable, finite @ gradient, 0)
    last = last if xp is np else jax.lax.stop_gradient(last)
    values, covariance = _in_range(xp, found.parameters - last, known_of.covariance)
    weak = free[2] & (covariance[2, 2] > WEAK**2)
    outcome = decided(
        (weak, "weak"),
        (noise_known & (1 - len(alone) * xp.minimum(*alone) > _MISFIT), "misfit"),
        (twofold, "undecided"),
        (xp.any(known_of.lost), "unobservable"),
        (free[2] & (abs(values[names.index("latitude")]) > POLE), "pole"),
        (~(usable & xp.all(xp.isfinite(values))), "unfinished"),
    )
    return AlignmentFit(
        model=with_values(found.model, values), readings=readings,
        estimate=Estimate(names, values, covariance, states=dict.fromkeys(set(names) - o.chosen, "held"), quantities=QUANTITIES),
        rank=known_of.rank, hidden=known_of.hidden, lost=known_of.lost,
        prior_only=free & (table.certainty > 0) & (xp.diagonal(finite) * table.certainty**2 > 0.95**2),
        accel_residual=r[: len(readings.positions)], gyro_residual=r[n : n + len(readings.positions)], chi_square=chi_square,
        degrees_of_freedom=dof, p_value=p_value, noise_known=noise_known, outcome=outcome,
    )  # fmt: skip


def _in_range(xp: Any, values: Any, covariance: Any) -> tuple[Any, Any]:
    """Rewrite the attitude with the pitch between -90 and 90 degrees and the angles in (-pi, pi]."""
    over = xp.cos(values[1]) < 0
    turn = xp.where(over, np.pi, 0.0)
    angles = [wrap(values[0] + turn), wrap(xp.where(over, np.pi - values[1], values[1])), wrap(values[2] + turn)]
    sign = xp.where(over & (np.arange(len(values)) == 1), -1.0, 1.0)
    return xp.concatenate([xp.stack(angles), values[3:]]), covariance * sign[:, None] * sign[None, :]


def _spare(found: Fit, table: Table, covariance: AnyArray) -> tuple[AnyArray, AnyArray]:
    """(2,) degrees of freedom of each sensor, and sums of its squared residuals; `covariance` is zero where nothing is determined."""
    xp, n = array_module(found, table), table.readings.shape[1]
    left = 1 - xp.einsum("mi,ij,mj->m", found.jacobian, covariance, found.jacobian)
    return xp.sum(xp.where(table.measured, left[: 2 * n].reshape(2, n), 0.0), axis=1), xp.sum(
        found.residuals[: 2 * n].reshape(2, n) ** 2, axis=1
    )


def _freedom(found: Fit, table: Table, fitted: AlignmentFit, estimated: dict[str, float]) -> np.ndarray:
    """Degrees of freedom of every variance (Satterthwaite), from the shares of the sensors with an estimated noise level."""
    finite, n = np.where(np.isfinite(fitted.covariance), fitted.covariance, 0), table.readings.shape[1]
    doubt = np.zeros(len(fitted.names))
    for i, name in enumerate(SENSORS):
        if name in estimated:
            rows = found.jacobian[i * n : (i + 1) * n] @ finite
            doubt += np.sum(rows**2, axis=0) ** 2 / estimated[name]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(doubt > 0, np.diagonal(finite) ** 2 / doubt, np.inf)


def _level(noise: Any, places: Any, here: Any) -> Any:
    """White noise N with the same mean variance as the readings."""
    xp, variance = array_module(noise, places, here), covariance_of(noise, places, here)
    variance = variance if variance.ndim == 1 else xp.diagonal(variance)
    mean = xp.sum(xp.where(here, variance * places.dwell, 0)) / xp.maximum(xp.sum(xp.where(here, 1.0, 0.0)), 1.0)
    return xp.sqrt(xp.where(xp.any(here), mean, 1.0))


def _told(found: AlignmentFit, freedom: np.ndarray, readings: Readings, o: _Options, twofold: bool, nominal: list[str]) -> AlignmentFit:
    """Add findings and states to a host result; `nominal` names the sensors whose noise is neither given nor estimated."""
    dof, known = int(found.degrees_of_freedom), found.noise_known
    # without readings along the table's axis the mirrored attitude gives the same ones
    mirrored = not {"z", "-z", "fixed z"} & set(readings.positions.mounting) and {"phi", "psi"} <= o.chosen and not twofold
    findings = list(findings_of(found.outcome, names=", ".join(found.unobservable)))
    cases = {"noise_from_residuals": not known, "nominal_noise": nominal, "unchecked": dof <= 0, "mirrored": mirrored}
    findings += [FINDINGS(code, nominal if code == "nominal_noise" else ()) for code, there in cases.items() if there]
    if np.any(found.prior_only):
        findings.append(FINDINGS("prior_alone", names=", ".join(np.array(found.names)[found.prior_only])))
    gone = {*found.undetermined, *(() if has_number(found.outcome) else ("psi",))} & o.chosen
    if twofold:  # roots have different latitudes, or different errors of the gyro
        gone |= {"psi", "latitude"} if "latitude" in o.chosen else o.chosen & {"psi", *NEEDED["gyro"]}
    gone = o.chosen if OUTCOMES[int(found.outcome)] == "unfinished" else gone
    states = found.estimate.states | dict.fromkeys(gone, "open")
    estimate = Estimate(found.names, found.estimate.values, found.covariance, freedom, states, found.estimate.quantities)
    p_value = float(found.p_value) if known and dof > 0 else None
    return dataclasses.replace(found, estimate=estimate, p_value=p_value, findings=tuple(findings))
