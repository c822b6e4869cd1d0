"""`population`: combine many devices of one type, to describe the type and to improve the estimate of each device."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._answer import Finding, Grid, Number, Result, Section
from .._errors import DataError
from .._precision import host_float64
from .._quality import checked_confidence
from .._types import AnyArray, Groups
from ..fitting._hierarchy import Hierarchy, sample_hierarchy
from ..noise import NoiseFit
from ._findings import FEWEST, FINDINGS
from ._leaves import Leaves, Recording, of_estimates, of_noise
from ._odd import chances

_MANY = 1000  # number of recordings above which fewer sweeps suffice, because the population is then well known


class Population(Result):
    """Parameters of a type of device, and of each recording: by itself, and combined with the population.

    Noise coefficients are described by their logarithms: a standard deviation of 0.2 means 20 %. Other parameters, such as a hard iron,
    are described directly, in their own unit.

    Attributes
    ----------
    terms : names of the parameters, in their order along the last axis of the arrays.
    median, median_interval : (p,) and (p, 2), parameters of the middle device; in a fleet with covariates, at their mean.
    levels : names of the levels: "device", those of `levels=`, and last "recording" or "rest", which varies within all others.
    components, components_interval : (levels, p) and (levels, p, 2), standard deviation between the groups of each level; the variance
        components are their squares. The first, between devices, is `spread`; the last of several is `repeatability`.
    effect, effect_interval : (c, p) and (c, p, 2), change for one standard deviation of each covariate, or of a class against the first.
    raw, raw_interval : (n, p) and (n, p, 2), each recording by itself; 0 if a term was not found.
    pooled, pooled_interval : the same combined with the population. The intervals include the uncertainty of the population.
    device_values, device_interval : (g, p) and (g, p, 2), the middle of each device over its recordings.
    seen, seen_error : (n, p) estimate of each recording by itself near the population (logarithms for noise), and its standard error.
    chance : (g, p) probability that a usual device is as far from the middle as this one; small for an odd unit.
    outliers : (device, term) pairs whose chance is below `false_alarm`.
    devices, recordings : names of the devices (g,), and the device of each recording (n,).
    covariates : names of the covariates; for covariates that are words, one name per class except the first.
    logarithm : whether the model uses logarithms.
    confidence, false_alarm : level of the intervals, and of the outliers.
    findings : what to know; "odd" for each of the outliers.

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
    levels: tuple[str, ...] = eqx.field(static=True)
    components: AnyArray
    components_interval: AnyArray
    effect: AnyArray
    effect_interval: AnyArray
    raw: AnyArray
    raw_interval: AnyArray
    pooled: AnyArray
    pooled_interval: AnyArray
    device_values: AnyArray
    device_interval: AnyArray
    seen: AnyArray
    seen_error: AnyArray
    chance: AnyArray
    outliers: tuple[tuple[Any, str], ...] = eqx.field(static=True)
    devices: tuple[Any, ...] = eqx.field(static=True)
    recordings: tuple[Any, ...] = eqx.field(static=True)
    covariates: tuple[str, ...] = eqx.field(static=True)
    logarithm: bool = eqx.field(static=True)
    confidence: float = eqx.field(static=True)
    false_alarm: float = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def spread(self) -> AnyArray:
        """(p,) standard deviation between devices."""
        return self.components[0]

    @property
    def spread_interval(self) -> AnyArray:
        """(p, 2) interval of `spread`."""
        return self.components_interval[0]

    @property
    def repeatability(self) -> AnyArray:
        """(p,) standard deviation within all levels; NaN if each device has one recording."""
        return self.components[-1] if len(self.levels) > 1 else np.full(len(self.terms), np.nan)

    @property
    def repeatability_interval(self) -> AnyArray:
        """(p, 2) interval of `repeatability`."""
        return self.components_interval[-1] if len(self.levels) > 1 else np.full((len(self.terms), 2), np.nan)

    @property
    def headline(self) -> str:
        """The number of devices and recordings, and of devices that stand out."""
        odd = len({device for device, _ in self.outliers})
        return f"{len(self.recordings)} recordings of {len(self.devices)} devices, {odd or 'no'} of them odd"

    def sections(self) -> list[Section]:
        """The middle device, the standard deviations between groups of each level, and the effects of the covariates."""
        lines: list[tuple[str, str, AnyArray, AnyArray]] = [("middle device", "", self.median, self.median_interval)]
        levels = zip(self.levels, self.components, self.components_interval, strict=True)
        lines += [(f"deviation of {level}", f".deviation.{level}", values, limits) for level, values, limits in levels]
        effects = zip(self.covariates, self.effect, self.effect_interval, strict=True)
        lines += [(f"effect of {name}", f".effect.{name}", values, limits) for name, values, limits in effects]

        def row(place: str, values: AnyArray, limits: AnyArray) -> tuple[Number, ...]:
            pairs = zip(self.terms, values, limits, strict=True)
            return tuple(Number(term + place, float(x), float(low), float(high)) for term, x, (low, high) in pairs)

        note = "Deviations and effects are those of the logarithm: 0.2 means 20 %." if self.logarithm else ""
        return [Grid("population", "population", self.terms, tuple((line[0], row(*line[1:])) for line in lines), note=note)]


@host_float64
def population(
    fits: Sequence[Any], *, devices: Groups | None = None, levels: Mapping[str, Groups] | None = None,
    covariates: Mapping[str, Any] | None = None, terms: Sequence[str] | None = None, confidence: float = 0.95,
    false_alarm: float = 0.05, seed: int = 0,
) -> Population:  # fmt: skip
    r"""Pool the parameters of many devices of one type.

    Each parameter x (for noise, the logarithm of a coefficient) is the value of the type, plus effects of the device, of levels within the
    device such as recording and axis, and a rest:

    .. math:: x_i = \mu + z_i\beta + u_{d(i)} + \sum_l v^{(l)}_{d(i),l(i)} + e_i,\qquad u \sim t_\nu(0, s^2),\quad
        v^{(l)}, e \sim N(0, s_l^2)

    Every noise recording enters with its own likelihood, which for an undetected term only has an upper end. Other fits enter with their
    values and covariance. The distribution between devices may have heavy tails, estimated from the devices, so that an odd unit is not
    pulled towards the others. Values and intervals come from draws of the joint posterior, so the intervals include the uncertainty of the
    population. Short records gain most; a long record already determines its own parameters.

    A device is odd in a term if only the share `false_alarm` of usual devices is as far from the middle. The device itself is left out of
    the population with which it is compared.

    Parameters
    ----------
    fits : for each recording a `NoiseFit` of one channel by method "whittle"; or a result with an `estimate`, such as those of
        `jaxcal.magnetometer.fit` and `jaxcal.imu.multi_position`.
    devices : name of the device of each recording; by default each recording is from a different device.
    levels : name of a level -> name of the group of each fit, such as {"recording": ..., "axis": ...}. Groups belong to a device: recording
        1 of two devices means two recordings, and an axis of a device is the same in all of its recordings.
    covariates : name -> number or word for each recording, such as its temperature, age or batch.
    terms : parameters to pool. By default those of N, B, K and Q that a quarter of the fits show, or all parameters of other fits. Terms
        that are not pooled keep their fitted values.
    confidence : level of the intervals.
    false_alarm : share of usual devices that are named as outliers in a term.
    seed : seed of the draws.

    Returns
    -------
    Population

    Raises
    ------
    DataError
        If there are fewer than five devices, the lists differ in length, a fit has several channels or no likelihood, no term is
        found often enough, or a level has only one group in each device.

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
    A. Gelman et al., Bayesian Data Analysis, 2013, chapters 5 and 17; priors of variances: M.-E. Perez, L. R. Pericchi and
    I. C. Ramirez, Bayesian Analysis 12, 2017.
    """
    confidence = checked_confidence(confidence)
    fits = list(fits)
    names, member, order = _devices(len(fits), devices)
    groups, titles = _levels(levels, member, names)
    z, labels = _covariates(covariates, len(fits))
    leaves = _leaves(fits, terms, confidence)
    design = np.concatenate([np.ones((len(fits), 1)), z], axis=1)
    members = [member, *groups] if len(order) < len(fits) or groups else []
    many = len(fits) > _MANY
    drawn = sample_hierarchy(
        leaves.log_likelihood, jnp.asarray(leaves.start), jax.tree.map(jnp.asarray, leaves.data), jnp.asarray(leaves.step),
        jnp.asarray(design), tuple(map(jnp.asarray, members)), tuple(int(one.max()) + 1 for one in members),
        jnp.ones(len(leaves.names)), jax.random.key(seed), 300 if many else 600, 500 if many else 1000, 1 if many else 4, not many,
    )  # fmt: skip
    return _summary(leaves, drawn, design, members, (names, order, titles if members else ("device",), labels), confidence, false_alarm)


def _summary(
    leaves: Leaves, drawn: Hierarchy, design: np.ndarray, members: list[np.ndarray], named: tuple, confidence: float, false_alarm: float
) -> Population:
    """Summarise the draws as medians and intervals, and find the odd units."""
    names, order, titles, labels = named
    items, beta, deviations = (np.asarray(value) for value in (drawn.items, drawn.coefficients, drawn.deviations))
    scale, ends = leaves.scale, [(1.0 - confidence) / 2.0, (1.0 + confidence) / 2.0]

    def interval(draws):
        return np.moveaxis(np.quantile(draws, ends, axis=0), 0, -1)

    def back(values):
        return np.exp(values) if leaves.logarithm else values

    device = beta[:, :1] + np.asarray(drawn.effects[0]) if members else items
    usual = np.median(beta, axis=0)
    middle = design @ usual
    seen, error = leaves.seen_from(middle, np.sqrt(np.sum(np.median(deviations, axis=0) ** 2, axis=0)))
    member = members[0] if members else np.arange(len(names))
    chance = chances(seen - middle, error**2, member, members[1:], usual[0], drawn)
    accepted = float(np.mean(np.asarray(drawn.accepted)))
    odd = [(order[i], leaves.names[j], float(chance[i, j])) for i, j in np.argwhere(chance < false_alarm)]
    said = [FINDINGS("odd", cost=-rare, device=device, term=term, percent=100.0 * rare) for device, term, rare in odd]
    said += FINDINGS.over("stuck", 1 - accepted)
    return Population(
        terms=leaves.names, median=back(usual[0] * scale), median_interval=back(interval(beta[:, 0] * scale)), levels=titles,
        components=np.median(deviations, axis=0) * scale, components_interval=interval(deviations * scale),
        effect=usual[1:] * scale, effect_interval=interval(beta[:, 1:] * scale), raw=leaves.raw, raw_interval=leaves.interval,
        pooled=back(np.median(items, axis=0) * scale), pooled_interval=back(interval(items) * scale[:, None]),
        device_values=back(np.median(device, axis=0) * scale), device_interval=back(interval(device) * scale[:, None]),
        seen=seen * scale, seen_error=error * scale, chance=chance,
        outliers=tuple((device, term) for device, term, _ in odd), devices=order, recordings=names,
        covariates=labels, logarithm=leaves.logarithm, confidence=confidence, false_alarm=false_alarm, findings=tuple(said),
    )  # fmt: skip


def _leaves(fits: list[Any], terms: Sequence[str] | None, confidence: float) -> Leaves:
    """The information of each fit; either all fits are of noise, or none is."""
    if not any(isinstance(fit, NoiseFit | Recording) for fit in fits):
        return of_estimates(fits, terms, confidence)
    for i, fit in enumerate(fits):
        if not isinstance(fit, Recording) and (not isinstance(fit, NoiseFit) or fit.spectrum is None or np.ndim(fit.noise.N)):
            raise DataError(f"fit {i}: expected a NoiseFit of one channel by method 'whittle'; got {type(fit).__name__}", code="fits")
    return of_noise([fit if isinstance(fit, Recording) else Recording.of(fit) for fit in fits], terms)


def _devices(count: int, devices: Groups | None) -> tuple[tuple[Any, ...], np.ndarray, tuple[Any, ...]]:
    """Device of each recording, its number, and the devices in order of appearance."""
    names = (
        tuple(range(count)) if devices is None else tuple(one.item() if isinstance(one, np.generic | jax.Array) else one for one in devices)
    )
    if len(names) != count:
        raise DataError(f"{count} fits and {len(names)} names of devices; give the device of each recording", code="names")
    order = tuple(dict.fromkeys(names))
    if len(order) < FEWEST:
        raise DataError(f"{len(order)} devices; a population needs {FEWEST}, and noise.fit_recordings takes those of one", code="few")
    number = {name: i for i, name in enumerate(order)}
    return names, np.array([number[name] for name in names]), order


def _levels(levels: Mapping[str, Groups] | None, member: np.ndarray, names: tuple[Any, ...]) -> tuple[list[np.ndarray], tuple[str, ...]]:
    """Group number of each fit for every level, and the names of all levels."""
    found, titles = [], ["device"]
    for name, labels in (levels or {}).items():
        labels = list(labels)
        if len(labels) != len(names):
            raise DataError(f"level {name!r}: {len(names)} fits and {len(labels)} names; give the group of each fit", code="names")
        pairs = list(zip(names, labels, strict=True))
        number = {pair: i for i, pair in enumerate(dict.fromkeys(pairs))}
        if len(number) == len(names) or len(number) == member.max() + 1:
            alone = "each fit alone" if len(number) == len(names) else "one group in each device"
            raise DataError(f"level {name!r} has {alone}: it cannot be told from what is left; leave it out", code="level")
        found.append(np.array([number[pair] for pair in pairs]))
        titles.append(name)
    return found, (*titles, "rest" if found else "recording")


def _covariates(covariates: Mapping[str, Any] | None, count: int) -> tuple[np.ndarray, tuple[str, ...]]:
    """Columns with mean 0 and, for numbers, standard deviation 1; and their names."""
    columns, labels = [], []
    for name, given in (covariates or {}).items():
        words = [str(one) for one in given] if any(isinstance(one, str) for one in given) else []
        classes = sorted(set(words))
        if words and len(words) == count and 1 < len(classes) < count:
            for one in classes[1:]:
                column = np.array([word == one for word in words], dtype=float)
                columns.append(column - column.mean())
                labels.append(f"{name} {one}")
            continue
        values = np.array([np.nan] if words else given, dtype=float)
        if values.shape != (count,) or not np.isfinite(values).all() or not np.ptp(values) > 0.0:
            raise DataError(f"covariate {name!r}: expected differing numbers, or words of a few, for {count} fits", code="covariate")
        columns.append((values - values.mean()) / values.std())
        labels.append(name)
    return np.stack(columns, axis=1) if columns else np.zeros((count, 0)), tuple(labels)
