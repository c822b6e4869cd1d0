"""`population`: what many devices of one type say about the type, and the type about each of them."""

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import host_float64
from .._quality import checked_confidence
from .._results import Result, Row
from .._types import AnyArray
from ..fitting._hierarchy import FREEDOM, sample_hierarchy
from ..noise import NoiseFit

_WARM, _DRAWS, _THIN = 1000, 1000, 5
_SINGLE, _PER_DECADE = 16, 12  # bins of one ordinate, and bins to the decade beyond: they hold all that smooth densities differ by
_FEWEST = 5  # devices
_SEEN = 0.25  # share of the fits that must show a term for it to be pooled
_FLAT = 1e-3  # precision of a logarithm of which the record says nothing
_STARTS = 0.05  # of a coefficient that is not there, over the median of those that are


class Population(Result):
    """Coefficients of a type of device, of each recording by itself, and of each with what the others say.

    Attributes
    ----------
    terms : names of the coefficients, in this order along the last axis of the arrays.
    median, median_interval : (p,) and (p, 2), coefficient of the middle device; of a fleet with covariates that at their mean.
    spread, spread_interval : (p,) and (p, 2), standard deviation of the logarithm between devices; 0.2 is 20 %.
    repeatability, repeatability_interval : the same between recordings of one device; NaN where no device has two.
    effect, effect_interval : (c, p) and (c, p, 2), change of the logarithm for one standard deviation of each covariate.
    raw, raw_interval : (n, p) and (n, p, 2), each recording by itself; 0 where a term was not found.
    pooled, pooled_interval : the same with what the population says. The intervals allow for what is not known of the population.
    device_values, device_interval : (g, p) and (g, p, 2), the middle of each device over its recordings.
    chance : (g, p) probability that a device of this population is as far from its middle as this one; small for an odd unit.
    outliers : (device, term) of which the chance is below the false-alarm rate.
    devices, recordings : names of the devices (g,), and of the device of each recording (n,).
    covariates : names of the covariates.
    confidence, false_alarm : levels of the intervals and of the outliers.
    warnings : sentences.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> sizes = 0.01 * np.exp(0.2 * np.random.default_rng(0).standard_normal(8))
    >>> records = [jaxcal.noise.Noise(N=n).simulate(2000, rate=100.0, seed=i) for i, n in enumerate(sizes)]
    >>> found = jaxcal.batch.population([jaxcal.noise.fit(y, 100.0) for y in records], terms=("N",))
    >>> low, high = found.median_interval[0]
    >>> bool(low < 0.01 < high)
    True
    """

    terms: tuple[str, ...] = eqx.field(static=True)
    median: AnyArray
    median_interval: AnyArray
    spread: AnyArray
    spread_interval: AnyArray
    repeatability: AnyArray
    repeatability_interval: AnyArray
    effect: AnyArray
    effect_interval: AnyArray
    raw: AnyArray
    raw_interval: AnyArray
    pooled: AnyArray
    pooled_interval: AnyArray
    device_values: AnyArray
    device_interval: AnyArray
    chance: AnyArray
    outliers: tuple[tuple[Any, str], ...] = eqx.field(static=True)
    devices: tuple[Any, ...] = eqx.field(static=True)
    recordings: tuple[Any, ...] = eqx.field(static=True)
    covariates: tuple[str, ...] = eqx.field(static=True)
    confidence: float = eqx.field(static=True)
    false_alarm: float = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def verdict(self) -> str:
        """The word "good", or "weak" where there are warnings."""
        return "weak" if self.warnings else "good"

    @property
    def reason(self) -> str:
        """How many devices and recordings there are, and which stand out."""
        odd = ", ".join(f"{device} in {term}" for device, term in self.outliers)
        return f"{len(self.recordings)} recordings of {len(self.devices)} devices; {f'odd: {odd}' if odd else 'no device stands out'}"

    def _rows(self) -> list[Row]:
        rows = []
        for i, term in enumerate(self.terms):
            listed = [
                (term, self.median, self.median_interval, "SI", "middle device"),
                (f"spread of {term}", self.spread, self.spread_interval, "", "between devices"),
                (f"repeatability of {term}", self.repeatability, self.repeatability_interval, "", "between recordings of a device"),
            ]
            for name, value, limits, unit, remark in listed:
                if np.isfinite(value[i]):
                    rows.append(Row(name, value[i], limits[i, 0], limits[i, 1], unit, remark))
        return rows


@host_float64
def population(
    fits: Sequence[NoiseFit], *, devices: Sequence[Hashable] | None = None, covariates: Mapping[str, Any] | None = None,
    terms: Sequence[str] | None = None, confidence: float = 0.95, false_alarm: float = 0.05, seed: int = 0,
) -> Population:  # fmt: skip
    r"""Pool the noise coefficients of many devices of one type.

    The logarithm of each coefficient is that of the type, plus an effect of the device, plus one of the recording:

    .. math:: \ln c_i = \mu + z_i\beta + u_{d(i)} + e_i,\qquad u_d \sim t_5(0, s^2)

    Every recording enters with its own likelihood, which for a term that was not found has only an upper end. The law between devices
    has heavy tails, so that an odd unit is not drawn in. Values and intervals come from draws of the joint posterior: the intervals
    allow for what is not known of the population. A short record gains most; a long one is known by itself.

    Parameters
    ----------
    fits : `NoiseFit` of each recording, of one channel, by method "whittle".
    devices : name of the device of each recording; by default each is a device of its own.
    covariates : name -> number for each recording, such as its temperature or age.
    terms : coefficients to pool; by default those of N, B, K and Q that a quarter of the fits show. The others stay as fitted.
    confidence : level of the intervals.
    false_alarm : share of usual devices that may be named as outliers in a term; about 2 % were at 5 % (12 simulated fleets).
    seed : of the draws.

    Returns
    -------
    Population

    Raises
    ------
    DataError
        If there are fewer than five devices, the lists differ in length, a fit has several channels or no likelihood, or no term is
        found often enough.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> sizes = 0.01 * np.exp(0.2 * np.random.default_rng(0).standard_normal(8))
    >>> records = [jaxcal.noise.Noise(N=n).simulate(2000, rate=100.0, seed=i) for i, n in enumerate(sizes)]
    >>> found = jaxcal.batch.population([jaxcal.noise.fit(y, 100.0) for y in records], terms=("N",))
    >>> low, high = found.spread_interval[0]
    >>> bool(low < 0.2 < high), found.pooled.shape
    (True, (8, 1))

    References
    ----------
    A. Gelman et al., Bayesian Data Analysis, 2013, chapters 5 and 17; half-Cauchy priors: A. Gelman, Bayesian Analysis 1, 2006.
    """
    confidence = checked_confidence(confidence)
    names, member, order = _devices(fits, devices)
    z, labels = _covariates(covariates, len(fits))
    chosen = _terms(fits, terms)
    x0, root, error, data = _starts(fits, chosen)
    design = np.concatenate([np.ones((len(fits), 1)), z], axis=1)
    nested = len(order) < len(fits)
    drawn = sample_hierarchy(
        _log_likelihood, jnp.asarray(x0), jax.tree.map(jnp.asarray, data), jnp.asarray(root), jnp.asarray(design), jnp.asarray(member),
        len(order), nested, jax.random.key(seed), _WARM, _DRAWS, _THIN,
    )  # fmt: skip
    items, groups, beta, between, within = (np.asarray(value) for value in drawn[:5])
    ends = [(1.0 - confidence) / 2.0, (1.0 + confidence) / 2.0]

    def interval(draws):
        return np.moveaxis(np.quantile(draws, ends, axis=0), 0, -1)

    device = beta[:, :1] + groups if nested else items
    core = _core()  # the scale of the t law over the standard deviation of a normal population
    raw = np.array([[float(fit.noise.coefficient(term)) for term in chosen] for fit in fits])
    raw_interval = np.array([[[float(end) for end in fit.interval[term]] for term in chosen] for fit in fits])
    middle = design @ np.median(beta, axis=0) if not nested else np.broadcast_to(np.median(beta[:, 0], axis=0), (len(order), len(chosen)))
    chance = _chance(x0, error, member, len(order), middle, np.median(between, axis=0) * core, np.median(within, axis=0), nested)
    odd = tuple((order[i], chosen[j]) for i, j in np.argwhere(chance < false_alarm))
    nothing = np.full(len(chosen), np.nan)
    said = () if float(np.mean(np.asarray(drawn.accepted))) > 0.05 else ("the draws hardly moved: the values are not to be trusted",)
    return Population(
        terms=chosen, median=np.exp(np.median(beta[:, 0], axis=0)), median_interval=np.exp(interval(beta[:, 0])),
        spread=np.median(between, axis=0) * core, spread_interval=interval(between) * core,
        repeatability=np.median(within, axis=0) if nested else nothing,
        repeatability_interval=interval(within) if nested else np.stack([nothing, nothing], axis=1),
        effect=np.median(beta[:, 1:], axis=0), effect_interval=interval(beta[:, 1:]), raw=raw, raw_interval=raw_interval,
        pooled=np.exp(np.median(items, axis=0)), pooled_interval=np.exp(interval(items)),
        device_values=np.exp(np.median(device, axis=0)), device_interval=np.exp(interval(device)), chance=chance, outliers=odd,
        devices=order, recordings=names, covariates=labels, confidence=confidence, false_alarm=false_alarm, warnings=said,
    )  # fmt: skip


def _devices(fits: Sequence[Any], devices: Sequence[Hashable] | None) -> tuple[tuple[Any, ...], np.ndarray, tuple[Any, ...]]:
    """Device of each recording, its number, and the devices in their order."""
    names = tuple(range(len(fits))) if devices is None else tuple(devices)
    if len(names) != len(fits):
        raise DataError(f"{len(fits)} fits and {len(names)} names of devices; give the device of each recording")
    order = tuple(dict.fromkeys(names))
    if len(order) < _FEWEST:
        raise DataError(f"{len(order)} devices: a population needs {_FEWEST} at least; for recordings of one take noise.fit_recordings")
    for i, fit in enumerate(fits):
        if not isinstance(fit, NoiseFit) or fit.spectrum is None or np.ndim(fit.noise.N):
            raise DataError(f"fit {i}: expected a NoiseFit of one channel by method 'whittle'; got {type(fit).__name__}")
    return names, np.array([order.index(name) for name in names]), order


def _covariates(covariates: Mapping[str, Any] | None, count: int) -> tuple[np.ndarray, tuple[str, ...]]:
    """Columns of mean 0 and standard deviation 1, and their names."""
    columns = []
    for name, values in (covariates or {}).items():
        values = np.asarray(values, dtype=float)
        if values.shape != (count,) or not np.isfinite(values).all() or not np.ptp(values) > 0.0:
            raise DataError(f"covariate {name!r}: expected {count} finite numbers that differ, one for each fit")
        columns.append((values - values.mean()) / values.std())
    return np.stack(columns, axis=1) if columns else np.zeros((count, 0)), tuple(covariates or ())


def _terms(fits: Sequence[NoiseFit], terms: Sequence[str] | None) -> tuple[str, ...]:
    asked = tuple(terms) if terms is not None else ("Q", "N", "B", "K")
    found = {term: [float(fit.noise.coefficient(term)) > 0.0 and fit.verdict[term] != "not detected" for fit in fits] for term in asked
             if all(term in fit.terms for fit in fits)}  # fmt: skip
    if terms is not None and len(found) < len(asked):
        raise DataError(f"terms {asked}: every fit must have them; all have {tuple(found)}")
    chosen = tuple(term for term, seen in found.items() if np.mean(seen) >= (_SEEN if terms is None else 0.0) and any(seen))
    if not chosen:
        raise DataError("no term is found in a quarter of the fits: there is nothing to pool; record longer")
    return chosen


def _starts(fits: Sequence[NoiseFit], terms: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Logarithms of the coefficients to start from, roots of the covariances of the proposals, own variances, data of the likelihoods."""
    raw = np.array([[float(fit.noise.coefficient(term)) for term in terms] for fit in fits])
    usual = np.array([np.median(column[column > 0.0]) for column in raw.T])
    x0 = np.log(np.where(raw > _STARTS * usual, raw, usual))
    parts = [_merged(fit, terms) for fit in fits]
    rows = max(len(part["weight"]) for part in parts)
    data = {}
    for name in parts[0]:
        fill = 0.0 if name == "weight" else 1.0
        data[name] = np.stack(
            [np.pad(p[name], ((0, rows - len(p[name])), *((0, 0),) * (p[name].ndim - 1)), constant_values=fill) for p in parts]
        )
    shares = data["columns"] * np.exp(2.0 * x0)[:, None, :]
    slopes = 2.0 * shares / (shares.sum(axis=2) + data["base"])[..., None]
    information = 0.5 * np.einsum("nbp,nb,nbq->npq", slopes, data["weight"], slopes)
    spread = np.maximum(np.var(x0, axis=0), 0.05**2)
    own = np.diagonal(np.linalg.inv(information + _FLAT * np.eye(len(terms))), axis1=1, axis2=2)
    return x0, np.linalg.cholesky(np.linalg.inv(information + np.diag(1.0 / spread))), own, data


def _merged(fit: NoiseFit, terms: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Density, weight and columns of the bins that the fit used, neighbours together; `base` is what the other terms give."""
    held: Any = fit.spectrum
    used = np.asarray(held.used) & (np.asarray(held.edf) > 0)
    f, density, model, weight = (np.asarray(one)[used] for one in (held.frequency, held.density, held.model, held.edf))
    columns = np.stack([np.asarray(held.columns[term])[used] for term in terms], axis=1)
    own = columns @ np.square([float(fit.noise.coefficient(term)) for term in terms])
    number = np.floor(_PER_DECADE * np.log10(f / f[0]))
    number[:_SINGLE] = -np.arange(_SINGLE, 0, -1)[: len(f)]
    starts = np.flatnonzero(np.diff(number, prepend=-np.inf) != 0)
    total = np.add.reduceat(weight, starts)

    def mean(values):
        return np.add.reduceat((values.T * weight).T, starts, axis=0) / total.reshape(-1, *(1,) * (values.ndim - 1))

    base = np.maximum(mean(model - own), 0.0)
    return {"density": mean(density), "weight": total, "columns": mean(columns), "base": base}


def _log_likelihood(x: Any, data: Any) -> Any:
    s = data["columns"] @ jnp.exp(2.0 * x) + data["base"]
    return -0.5 * jnp.sum(data["weight"] * (jnp.log(s) + data["density"] / s))


def _core() -> float:
    """Standard deviation of a normal population over the scale of the t law that fits it best: E[(nu+1) z^2 / (nu s^2 + z^2)] = 1."""

    def excess(scale):
        mean = scipy.integrate.quad(lambda z: (FREEDOM + 1) * z**2 / (FREEDOM * scale**2 + z**2) * scipy.stats.norm.pdf(z), -9, 9)[0]
        return mean - 1.0

    scale: Any = scipy.optimize.brentq(excess, 0.3, 1.5)
    return 1.0 / float(scale)


def _chance(
    x0: np.ndarray,
    own: np.ndarray,
    member: np.ndarray,
    groups: int,
    middle: np.ndarray,
    between: np.ndarray,
    within: np.ndarray,
    nested: bool,
) -> np.ndarray:
    """Two-sided probability of the distance of each device from its middle, (groups, p), its own error counted."""
    away, error = x0 - (middle[member] if nested else middle), own
    if nested:
        inverse = 1.0 / (own + within**2)
        total = np.zeros((groups, x0.shape[1]))
        np.add.at(total, member, inverse)
        mean = np.zeros_like(total)
        np.add.at(mean, member, inverse * away)
        away, error = mean / total, 1.0 / total
    return 2.0 * scipy.stats.norm.sf(np.abs(away) / np.sqrt(between**2 + error))
