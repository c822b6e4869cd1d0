"""`components`: variance components of measurements, with intervals; and `gauge`: a gauge study (gauge R&R)."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Number, Result, Section, listed
from .._errors import DataError
from .._precision import host_float64
from .._quality import checked_confidence
from .._types import AnyArray, Groups
from ._findings import FINDINGS

_DRAWS = 20_000  # number of draws for the generalised intervals
_SEED = 24  # seed of the draws: the same study always gives the same numbers
_POOL = 0.25  # p value above which an interaction counts as repeatability: the rule of the AIAG manual
_ROUNDING = 1e-13  # scatter of repeated measurements, relative to the largest, that rounding alone can make
_LARGEST = 4_000_000  # largest number of values times groups
_CATEGORIES = 1.41  # distinct categories: 1.41 times the standard deviation of parts over that of the gauge


class Components(Result):
    """Variance components of measurements. Variances are in the squared unit of the measurements, standard deviations in their unit.

    Attributes
    ----------
    names : levels, interactions as "part:operator", and last "repeatability".
    variance, interval : (k,) and (k, 2), variance of each component and its interval; 0 if the estimate is negative.
    degrees_of_freedom, mean_square, p_value : (k,) analysis of variance; p value of zero variance at this level, NaN for the last.
    pooled : names of interactions that were counted as repeatability.
    mean : mean of all measurements.
    ratios, ratio_interval : (q,) and (q, 2), results of a gauge study, in the order of `ratio_names`; empty for `components`.
    ratio_names : names of the ratios.
    confidence : level of the intervals.
    findings : "open" for each level of too few groups, whose interval goes beyond three times the deviation of all components.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.batch import components
    >>> rng = np.random.default_rng(0)
    >>> device = np.repeat(np.arange(12), 6)
    >>> values = rng.normal(size=12)[device] + 0.3 * rng.normal(size=72)
    >>> found = components(values, {"device": device})
    >>> found.names, bool(found.interval[1, 0] < 0.09 < found.interval[1, 1])
    (('device', 'repeatability'), True)
    """

    names: tuple[str, ...] = eqx.field(static=True)
    variance: AnyArray
    interval: AnyArray
    degrees_of_freedom: AnyArray
    mean_square: AnyArray
    p_value: AnyArray
    pooled: tuple[str, ...] = eqx.field(static=True)
    mean: float
    ratio_names: tuple[str, ...] = eqx.field(static=True)
    ratios: AnyArray
    ratio_interval: AnyArray
    confidence: float = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def headline(self) -> str:
        """The share of each component in the total variance."""
        shares = 100.0 * np.asarray(self.variance) / max(float(np.sum(self.variance)), np.finfo(float).tiny)
        return "; ".join(f"{name} {share:.1f} % of the variance" for name, share in zip(self.names, shares, strict=True))

    def sections(self) -> list[Section]:
        """Standard deviations of the components, and the ratios of a gauge study."""
        deviations = _numbers(self.names, np.sqrt(self.variance), np.sqrt(self.interval))
        tables: list[Section] = [listed("deviation", "standard deviation", deviations)]
        ratios = _numbers(self.ratio_names, self.ratios, self.ratio_interval)
        return tables + ([listed("ratios", "gauge study", ratios)] if ratios else [])


def _numbers(names: tuple[str, ...], values: AnyArray, limits: AnyArray) -> list[tuple[str, Number]]:
    return [(name, Number(name, float(x), float(a), float(b))) for name, x, (a, b) in zip(names, values, limits, strict=True)]


@host_float64
def components(values: Any, levels: Mapping[str, Groups], *, crossed: Sequence[str] = (), confidence: float = 0.95) -> Components:
    r"""Variance components of measurements by an analysis of variance.

    Each level is nested in those before it: recordings in devices, axes in recordings. Levels named in `crossed` have the same groups
    everywhere, such as operators who measure all parts; the model then includes an interaction for each pair of crossed levels. The sums of
    squares of the levels, taken one after the other, have the expectations

    .. math:: E\,MS_k = \sum_l c_{kl}\,\sigma_l^2

    which give the estimates. The intervals are generalised intervals: :math:`MS_k` is replaced with :math:`f_k MS_k/\chi^2_{f_k}`, drawn
    20,000 times. The sums of squares are independent chi-squares in balanced studies, and nearly so in others.

    Parameters
    ----------
    values : (n,) measurements without uncertainties. For fits with uncertainties use `population`.
    levels : name -> group of each measurement, the outermost first.
    crossed : names of levels that are crossed with one another.
    confidence : level of the intervals.

    Returns
    -------
    Components

    Raises
    ------
    DataError
        If there are too few measurements, a value is not finite, or a level cannot be separated from those before it.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.batch import components
    >>> rng = np.random.default_rng(0)
    >>> device, recording = np.repeat(np.arange(10), 6), np.tile(np.repeat([0, 1, 2], 2), 10)
    >>> effect = rng.normal(size=10)[device] + 0.5 * rng.normal(size=30)[3 * device + recording]
    >>> found = components(effect + 0.1 * rng.normal(size=60), {"device": device, "recording": recording})
    >>> found.names
    ('device', 'recording', 'repeatability')

    References
    ----------
    S. R. Searle, G. Casella and C. E. McCulloch, Variance Components, 1992 (expectations); S. Weerahandi, J. Am. Stat. Assoc. 88, 1993, and
    R. K. Burdick, C. M. Borror and D. C. Montgomery, Design and Analysis of Gauge R&R Studies, 2005 (intervals).
    """
    return _analysed(values, levels, tuple(crossed), checked_confidence(confidence), 1.0, None)


@host_float64
def gauge(
    values: Any, parts: Groups, operators: Groups, *, pool: float = _POOL, tolerance: float | None = None,
    confidence: float = 0.95,
) -> Components:  # fmt: skip
    r"""Gauge R&R: split the scatter of measurements into parts, operators and repeatability.

    Operators measure all parts several times. `ratios` reports what the AIAG manual asks for: the standard deviations EV (repeatability),
    AV (reproducibility: operators and their interaction with parts), GRR (both), PV (parts) and TV (total), the percentages of TV, and the
    number of distinct categories 1.41 PV/GRR, not rounded down.

    Parameters
    ----------
    values : (n,) measurements.
    parts, operators : part and operator of each measurement. A device may take the place of a part, and a turntable or a mounting that of
        an operator.
    pool : an interaction counts as repeatability if the p value of its F test is larger than this; 1 always keeps the interaction.
    tolerance : width of the tolerance, in the unit of the values; the ratios then include 6 GRR divided by it.
    confidence : level of the intervals.

    Returns
    -------
    Components

    Raises
    ------
    DataError
        As for `components`; or if there are fewer than two parts or operators, or no repeated measurements.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.batch import gauge
    >>> rng = np.random.default_rng(0)
    >>> part, operator, _ = (index.ravel() for index in np.indices((10, 3, 3)))
    >>> values = rng.normal(size=10)[part] + 0.2 * rng.normal(size=3)[operator] + 0.2 * rng.normal(size=90)
    >>> found = gauge(values, part, operator)
    >>> found.names, round(float(found.ratios[0]), 2)
    (('part', 'operator', 'part:operator', 'repeatability'), 0.18)

    References
    ----------
    AIAG, Measurement Systems Analysis, 4th edition, 2010; R. K. Burdick, C. M. Borror and D. C. Montgomery, Design and Analysis of Gauge
    R&R Studies, 2005.
    """
    if not 0.0 <= pool <= 1.0:
        raise DataError(f"pool must lie between 0 and 1; got {pool!r}")
    if tolerance is not None and not tolerance > 0.0:
        raise DataError(f"tolerance must be positive; got {tolerance!r}")
    levels = {"part": parts, "operator": operators}
    return _analysed(values, levels, ("part", "operator"), checked_confidence(confidence), pool, (tolerance,))


def _analysed(values: Any, levels: Mapping[str, Any], crossed: tuple[str, ...], confidence: float, pool: float, study: Any) -> Components:
    values = np.asarray(values, dtype=float)
    if values.ndim != 1 or not np.isfinite(values).all():
        raise DataError(f"values must be (n,) finite numbers; got shape {values.shape}")
    columns = _columns(values, levels, crossed)
    squares, freedom, expected = _table(values, columns)
    names, pooled = list(columns), {}
    ends = [(1.0 - confidence) / 2.0, (1.0 + confidence) / 2.0]
    for name in [one for one in names if ":" in one]:
        k, last = names.index(name), len(names)
        chance = scipy.stats.f.sf(squares[k] / freedom[k] / (squares[last] / freedom[last]), freedom[k], freedom[last])
        if chance > pool:
            # the data do not show it; its interval tells how large it may still be
            pooled[name] = np.maximum(np.quantile(_draws(squares, freedom, expected)[:, k], ends), 0.0)
            del columns[name]
            squares, freedom, expected = _table(values, columns)
            names = list(columns)
    means = squares / freedom
    drawn = _draws(squares, freedom, expected)
    variance = np.maximum(np.linalg.solve(expected, means), 0.0)
    tests = np.array([_chance(expected, means, freedom, k) for k in range(len(names))] + [np.nan])
    order = [*names, *pooled, "repeatability"]
    where = [*range(len(names)), *[-1] * len(pooled), len(names)]

    def placed(array: np.ndarray, fill: float) -> np.ndarray:
        return np.array([fill if at == -1 else array[at] for at in where])

    limits = dict(zip([*names, "repeatability"], np.maximum(np.quantile(drawn, ends, axis=0).T, 0.0), strict=True)) | pooled
    total, said = float(np.sqrt(np.sum(variance))), []
    for name, free in zip(names, freedom[:-1], strict=True):
        highest = float(np.sqrt(limits[name][1]))
        if highest > 3.0 * total > 0.0:
            said.append(FINDINGS("open", cost=highest / total, name=name, highest=highest, times=highest / total, free=free))
    ratio_names, ratios, ratio_limits = _reported(names, variance, np.maximum(drawn, 0.0), ends, study) if study else ((), [], [])
    return Components(
        names=tuple(order), variance=placed(variance, 0.0), interval=np.array([limits[name] for name in order]),
        degrees_of_freedom=placed(freedom, np.nan), mean_square=placed(means, np.nan),
        p_value=placed(tests, np.nan), pooled=tuple(pooled), mean=float(values.mean()),
        ratio_names=ratio_names, ratios=np.array(ratios), ratio_interval=np.array(ratio_limits).reshape(-1, 2), confidence=confidence,
        findings=tuple(said),
    )  # fmt: skip


def _columns(values: np.ndarray, levels: Mapping[str, Any], crossed: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Name -> group number of each measurement; groups that are not crossed are nested."""
    if not levels:
        raise DataError("there are no levels; name one, as {'device': ...}")
    unknown = [name for name in crossed if name not in levels]
    if unknown:
        raise DataError(f"crossed: there is no level {', '.join(unknown)}; levels are {', '.join(levels)}")
    found: dict[str, np.ndarray] = {}
    outer = np.zeros(len(values), dtype=int)
    for name, labels in levels.items():
        labels = list(labels)
        if len(labels) != len(values):
            raise DataError(f"level {name!r}: {len(values)} values and {len(labels)} names; give the group of each value")
        own = _numbered(labels)
        found[name] = own if name in crossed else _numbered(list(zip(outer.tolist(), own.tolist(), strict=True)))
        if name not in crossed:
            outer = found[name]
    for one, other in itertools.combinations(crossed, 2):
        cell = _numbered(list(zip(found[one].tolist(), found[other].tolist(), strict=True)))
        if cell.max() + 1 < len(values):
            found[f"{one}:{other}"] = cell
    return found


def _numbered(labels: list[Any]) -> np.ndarray:
    number = {label: i for i, label in enumerate(dict.fromkeys(labels))}
    return np.array([number[label] for label in labels])


def _table(values: np.ndarray, columns: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sums of squares of each level after those before it, and of the rest; degrees of freedom; expectations of the mean squares."""
    n = len(values)
    if n * max(int(group.max()) + 1 for group in columns.values()) > _LARGEST:
        raise DataError(f"{n} values are too many: values times groups of a level may be {_LARGEST}; use jaxcal.batch.population")
    centred = values - values.mean()
    basis = np.full((n, 1), n**-0.5)
    members = [np.eye(group.max() + 1)[group] for group in columns.values()]
    squares, freedom, expected = [], [], []
    for name, indicator in zip(columns, members, strict=True):
        rest = indicator - basis @ (basis.T @ indicator)
        left, size, _ = np.linalg.svd(rest, full_matrices=False)
        new = left[:, size > 1e-8 * max(size.max(), 1.0)]
        if not new.shape[1]:
            raise DataError(f"level {name!r} cannot be told from those before it; leave it out")
        squares.append(float(np.sum((new.T @ centred) ** 2)))
        freedom.append(new.shape[1])
        expected.append([float(np.sum((new.T @ one) ** 2)) / new.shape[1] for one in members] + [1.0])
        basis = np.concatenate([basis, new], axis=1)
    left_over = n - basis.shape[1]
    if left_over < 1:
        raise DataError(f"{n} values for as many groups: none is left for the repeatability; measure each group twice")
    # the residuals themselves: a difference of two large sums of squares would be rounding where measurements hardly scatter
    rest = centred - basis @ (basis.T @ centred)
    squares.append(float(rest @ rest))
    if not squares[-1] > n * (_ROUNDING * float(np.max(np.abs(values)))) ** 2:
        raise DataError("repeated measurements are equal to rounding: record with a finer resolution")
    return np.array(squares), np.array([*freedom, left_over], dtype=float), np.array([*expected, [0.0] * len(members) + [1.0]])


def _draws(squares: np.ndarray, freedom: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Draws of the variances for generalised intervals, (draws, k); they may be negative."""
    drawn = squares / np.random.default_rng(_SEED).chisquare(freedom, (_DRAWS, len(freedom)))
    return np.linalg.solve(expected, drawn.T).T


def _chance(expected: np.ndarray, means: np.ndarray, freedom: np.ndarray, k: int) -> float:
    """P value of zero variance at level k: its mean square against the mix of others that would then have the same expectation."""
    target = expected[k].copy()
    target[k] = 0.0
    others = [i for i in range(len(means)) if i != k]
    mix = np.linalg.lstsq(expected[others].T, target, rcond=None)[0]
    parts = mix * means[others]
    if not parts.sum() > 0.0:
        return float("nan")
    effective = parts.sum() ** 2 / np.sum(parts**2 / freedom[others])  # Satterthwaite
    return float(scipy.stats.f.sf(means[k] / parts.sum(), freedom[k], effective))


def _reported(names: list[str], variance: np.ndarray, drawn: np.ndarray, ends: list[float], study: tuple) -> tuple:
    """Standard deviations and ratios of a gauge study, with their intervals."""

    def figures(v: np.ndarray) -> dict[str, Any]:
        part, repeat = v[..., names.index("part")], v[..., -1]
        again = sum((v[..., i] for i, name in enumerate(names) if name != "part"), np.zeros(v.shape[:-1]))
        tiny = np.finfo(float).tiny
        deviations = {"EV": repeat, "AV": again, "GRR": repeat + again, "PV": part, "TV": repeat + again + part}
        found = {name: np.sqrt(value) for name, value in deviations.items()}
        found |= {f"%{name}": 100.0 * found[name] / np.maximum(found["TV"], tiny) for name in ("EV", "AV", "GRR", "PV")}
        found["distinct categories"] = _CATEGORIES * found["PV"] / np.maximum(found["GRR"], tiny)
        if study[0] is not None:
            found["6 GRR of the tolerance"] = 6.0 * found["GRR"] / study[0]
        return found

    best, all_drawn = figures(variance), figures(drawn)
    return tuple(best), [float(value) for value in best.values()], [np.quantile(value, ends) for value in all_drawn.values()]
