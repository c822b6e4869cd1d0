"""`NoiseFit`: noise coefficients with their uncertainty; how estimators make one; and `NoiseFits`, those of the channels of a log."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Finding, Result, Results, Section, plain
from .._arrays import namespace
from .._errors import DataError
from .._frozen import made, replaced
from .._precision import map_ordered
from .._types import AnyArray, Held, Leaf
from ..allan import Deviation
from ..allan._uncertainty._edf import interval_factors
from ..fitting._estimate import NamedMatrix
from ._binned import LogLikelihood, likelihood_of
from ._likelihood import HINT, PRESENT, Limits
from ._model import Noise, noise_of
from ._sections import SENSORS, headline_of, sections_of
from ._solve import FILTER, LINE, Solved
from ._terms import Term


class FittedSpectrum(eqx.Module):
    """The spectrum that method "whittle" was fitted to, averaged in bins of frequency, and the fitted model in the same bins.

    Bins that a spectral line occupies are left out. Causes such as a step are removed from the record first, and its missing samples
    are estimated.

    Attributes
    ----------
    frequency : (bins,) mean frequency in Hz.
    density : (bins,) mean measured ordinate, a two-sided density, in the unit of the record squared per Hz.
    model : (bins,) density that the fitted model expects in the bin, in the same unit.
    edf : (bins,) number of ordinates in the bin, which are its degrees of freedom: where the model holds, edf * density / model
        follows a chi-square law.
    used : (bins,) True where the fit used the bin.
    columns : term -> (bins,) contribution of the term to `model` for a squared coefficient of one.

    Examples
    --------
    >>> import jaxcal
    >>> record = jaxcal.noise.Noise(N=1e-3).simulate(5000, rate=100.0, seed=0)
    >>> found = jaxcal.noise.fit(record, rate=100.0).spectrum
    >>> found.density.shape == found.model.shape, sorted(found.columns)
    (True, ['B', 'K', 'N', 'Q'])
    """

    frequency: AnyArray
    density: AnyArray
    model: AnyArray
    edf: AnyArray
    used: AnyArray
    columns: Mapping[str, AnyArray]


class NoiseFit(Result):
    """Fitted noise coefficients of one or several channels, with their uncertainty.

    For a record of several channels every array has the channels as its last axis, and `presence`, `spectrum` and `events` are tuples
    with one entry per channel. `channel(i)` gives the fit of one channel.

    Attributes
    ----------
    noise : fitted `Noise`, in SI units, with the spectral lines that were found as sinusoids.
    terms : names of the fitted terms, in the order of `covariance`. Lines, which the fit adds by itself, are only in `noise`.
    interval : term -> (low, high) at level `confidence`, in the unit of the coefficient. The low end is 0 if zero cannot be excluded.
    upper_limit : term -> one-sided upper limit at level `confidence`. It is shown in place of a term that is not detected.
    presence : term -> "present", "hint" or "not detected". A term is only a hint, with a finding, if other noise explains the record
        nearly as well. Empty for the methods without uncertainty, and under jit, vmap or grad, where no number is known yet:
        compare `significance` with its thresholds yourself, or fit outside of the transformation.
    significance : term -> fall of the chi-square when the term is added. Without the term it exceeds 2.71 in 5 % and 5.41 in 1 % of
        records. Method gls corrects it for the skewness of the Allan variance at long cluster times.
    covariance : of the *squared* coefficients, by the names of the terms: `covariance["N", "K"]`; channels last. In short records the
        estimates of B and K are skewed, and one that comes out low also has too small an error here. The intervals allow for this.
    goodness : probability of a worse chi-square in the band if the model were true; NaN for a traced record.
    longer_record : term -> record length in s that would give the coefficient to 10 %; inf for a coefficient of zero.
    band : (shortest, longest) cluster time in s that the fit uses.
    deviation : the `Deviation` of the record at all cluster sizes. Inside the band its edf and limits follow from the fitted model,
        outside from the noise type identified there. None if method "whittle" fitted a traced record.
    used : (clusters,) True for cluster sizes inside the band; channels last. None where `deviation` is None.
    duration : record length in s.
    confidence : level of the intervals and upper limits.
    method : name of the estimator. Methods "log" and "slope" give no uncertainty: the tables are empty and `covariance` is NaN.
    spectrum : `FittedSpectrum` that method "whittle" was fitted to; None for other methods, and for a traced record.
    events : (start in s, stop in s, description) for each step, warm-up or part of the record that a finding names, in order of time.
    findings : what to know about the record and the fit; the verdict is the worst severity.
    sensor : "gyro", "accel" or "mag" if `characterise` fitted a log. The coefficients are then printed in the units of data sheets.

    Examples
    --------
    >>> import jaxcal
    >>> record = jaxcal.noise.Noise(N=1e-3).simulate(5000, rate=100.0, seed=0)
    >>> found = jaxcal.noise.fit(record, rate=100.0)
    >>> found.presence["N"], f"{found.noise.N:.1e}", found.terms
    ('present', '9.9e-04', ('Q', 'N', 'B', 'K'))
    """

    noise: Noise
    interval: dict[str, tuple[Any, Any]]
    upper_limit: dict[str, Any]
    presence: dict[str, Any]
    significance: dict[str, Any]
    covariance: NamedMatrix
    goodness: Leaf
    longer_record: dict[str, Any]
    band: tuple[Any, Any]
    deviation: Any
    used: Held | None
    duration: float
    terms: tuple[str, ...] = eqx.field(static=True)
    confidence: float = eqx.field(static=True)
    method: str = eqx.field(static=True)
    spectrum: Any = None
    events: tuple[Any, ...] = ()
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())
    sensor: str = eqx.field(static=True, default="")

    @property
    def log_likelihood(self) -> LogLikelihood:
        """Log-likelihood of any noise model, given the part of the record that was fitted: one channel, method "whittle".

        Examples
        --------
        >>> import jaxcal
        >>> found = jaxcal.noise.fit(jaxcal.noise.Noise(N=1e-3).simulate(5000, rate=100.0, seed=0), rate=100.0)
        >>> bool(found.log_likelihood(found.noise) > found.log_likelihood(jaxcal.noise.Noise(N=1.1e-3)))
        True
        """
        if self.spectrum is None or np.ndim(self.noise.N):
            raise DataError('a likelihood belongs to one channel that was fitted by method "whittle"; take channel(i) of several')
        return likelihood_of(self.spectrum, self.noise, 1.0 / self.deviation.rate)

    _figure = ("allan", False)
    _unlisted = ("spectrum", "used")

    @staticmethod
    def _several(results: Mapping[str, "NoiseFit"]) -> Any:
        return NoiseFits(results)

    @property
    def headline(self) -> str:
        """How well N is known."""
        return headline_of(self._channels())

    def sections(self) -> list[Section]:
        """The coefficients with the floor of the curve; then, as details, record lengths, the band, and the curve itself."""
        return sections_of(self._channels())

    def _channels(self) -> dict[str, "NoiseFit"]:
        """Name -> fit of each channel; the name of a single channel is empty."""
        return {f"channel {i}": self.channel(i) for i in range(np.size(self.goodness))} if np.ndim(self.goodness) else {"": self}

    def _fields(self) -> dict[str, Any]:
        """Fields for JSON: the coefficients by term, and not the spectrum, which the record gives."""
        return super()._fields() | {"coefficients": {term: plain(self.noise.coefficient(term)) for term in self.terms}}

    def channel(self, index: int) -> "NoiseFit":
        """The fit of one channel of a record that has several.

        Examples
        --------
        >>> import jaxcal
        >>> noise = jaxcal.noise.Noise(N=[0.01, 0.02]).simulate(2000, rate=100.0, seed=1)
        >>> jaxcal.noise.fit(noise, rate=100.0).channel(1).presence["N"]
        'present'
        """
        found = map_ordered(lambda value: value[..., index], {name: getattr(self, name) for name in _NUMBERS})
        found |= {name: getattr(self, name)[index] for name in _EACH}
        found |= {name: None if (one := getattr(self, name)) is None else one.channel(index) for name in ("noise", "deviation")}
        own = tuple(one.of() for one in self.findings if one.subject == (f"channel {index}",))
        return replaced(self, presence={term: value[index] for term, value in self.presence.items()}, findings=own, **found)


class NoiseFits(Results[NoiseFit]):
    """Noise coefficients of the channels of a log: channel -> `NoiseFit`, as `characterise` returns.

    Channels are also attributes: `fits.gyro_x`. A channel named after a sensor, such as "gyro_x", has the units of data sheets.

    Parameters
    ----------
    results : channel -> `NoiseFit` of one channel.
    left_out : findings on channels without a fit.

    Examples
    --------
    >>> import jaxcal
    >>> gyro = jaxcal.noise.Noise(N=[1e-4, 1e-4, 2e-4]).simulate(5000, rate=100.0, seed=0)
    >>> fits = jaxcal.noise.characterise(jaxcal.Log(None, gyro=gyro, rate=100.0))
    >>> fits.verdict, fits.headline, fits.gyro_x.presence["N"]
    ('good', 'N to 3.9 % on every axis', 'present')
    """

    _figure = ("allan", False)

    def __init__(self, results: Mapping[str, NoiseFit], left_out: Iterable[Finding] = ()):
        if several := [name for name, fit in results.items() if np.ndim(fit.goodness)]:
            raise DataError(f"the fit of {several[0]} has several channels; NoiseFit.channel picks one", code="several_channels")
        sensor = {name: name.partition("_")[0] for name in results}
        sized = {name: replaced(fit, sensor=sensor[name] if sensor[name] in SENSORS else "") for name, fit in results.items()}
        super().__init__(sized, left_out)

    def __getattr__(self, name: str) -> NoiseFit:
        if name.startswith("_") or name not in self._results:
            raise AttributeError(f"no channel {name!r}; the channels are {', '.join(self.__dict__.get('_results', ()))}")
        return self._results[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._results]

    @property
    def headline(self) -> str:
        """How well N is known on the worst axis."""
        return headline_of(self._results) if self._results else ""

    def sections(self) -> list[Section]:
        """A table of coefficients for each sensor; then, as details, record lengths, bands, and the curves."""
        return sections_of(self._results)


_NUMBERS = ("interval", "upper_limit", "significance", "covariance", "goodness", "longer_record", "band", "used")
_EACH = ("spectrum", "events")  # fields that are tuples over the channels


def spectra_of(solved: Solved) -> list[FittedSpectrum]:
    """Bins of each record and the model there. Bins without an ordinate and those of spectral lines are left out."""
    bins, names = solved.bins, solved.names
    kept, used = (bins.weight > 0) & (bins.density > 0) & (solved.lines < LINE), solved.weight > 0
    level, model = bins.density * bins.unit[:, None], solved.level * bins.unit[:, None]
    return [
        made(FittedSpectrum, frequency=bins.frequency[here], density=level[i, here], model=model[i, here], edf=bins.weight[i, here],
             used=used[i, here], columns={name: bins.columns[here, k] for k, name in enumerate(names) if name != FILTER})
        for i, here in enumerate(kept)
    ]  # fmt: skip


def stacked(fits: list[NoiseFit]) -> NoiseFit:
    """Join the fits of the channels of one record into one result, channels last."""
    first, curves = fits[0], [fit.deviation for fit in fits]
    names = ("deviation", "lower", "upper", "edf", "count", "alpha", "skipped")
    return dataclasses.replace(
        first,
        noise=stacked_noises([fit.noise for fit in fits]),
        deviation=None if curves[0] is None else dataclasses.replace(curves[0], **{name: _joined(curves, name) for name in names}),
        presence={term: tuple(fit.presence[term] for fit in fits) for term in first.presence},
        findings=tuple(one.of(f"channel {i}") for i, fit in enumerate(fits) for one in fit.findings),
        **{name: _joined(fits, name) for name in _NUMBERS},
        **{name: tuple(getattr(fit, name) for fit in fits) for name in _EACH},
    )


def stacked_noises(found: list[Noise]) -> Noise:
    """Join the noise models of the channels of one record into one, channels last."""
    # channels with fewer lines or processes than others get additional ones of zero amplitude, so that all have the same structure
    for name in ("sinusoid", "markov"):
        lists = [getattr(noise, name) for noise in found]
        lists = [(*one, *((0.0, 1.0),) * (max(map(len, lists)) - len(one))) for one in lists]
        found = [dataclasses.replace(noise, **{name: one}) for noise, one in zip(found, lists, strict=True)]
    names = {term.name: term for noise in found for _, term in noise.further}
    own = [{term.name: (value, term) for value, term in noise.further} for noise in found]
    lists = [tuple(one.get(name, (0.0, term)) for name, term in names.items()) for one in own]
    return _joined([dataclasses.replace(noise, further=one) for noise, one in zip(found, lists, strict=True)])


def _joined(trees: list[Any], name: str = "") -> Any:
    """Stack the trees, or one attribute of each, into one tree with channels last."""
    trees = [getattr(tree, name) for tree in trees] if name else trees
    xp = namespace(trees, concrete=True)

    def stack(*values: Any) -> Any:
        return xp.stack([xp.asarray(value) for value in values], axis=-1) if eqx.is_array_like(values[0]) else values[0]

    return map_ordered(stack, *trees)


def assemble(
    theta, spread, limits: Limits | None, terms: tuple[Term, ...], curve: Any, duration: float, *, sinusoid=(),
    hints: Sequence[str] = (), xp: Any = np, **others,
) -> NoiseFit:  # fmt: skip
    """Make a `NoiseFit` from squared coefficients in the order of `terms`, their covariance and their limits, all in SI units.

    Without limits (None) the tables stay empty. Terms among `hints` are hints at most. `xp` is the module of the arrays. `others` are
    further fields of the result.
    """
    names, positive = tuple(term.name for term in terms), theta > 0.0
    guarded = xp.where(positive, theta, 1.0)  # keeps the derivative of the root finite where the coefficient is zero
    value = xp.where(positive, xp.sqrt(guarded), 0.0)
    tables: dict[str, Any] = {name: {} for name in ("interval", "upper_limit", "presence", "significance", "longer_record")}
    if limits is not None:
        relative, rises = xp.sqrt(xp.diagonal(spread)) / (2.0 * guarded), limits.significance
        columns = (
            zip(xp.sqrt(limits.low), xp.sqrt(limits.high), strict=True),
            xp.sqrt(limits.upper),
            ["present" if rise > PRESENT else "hint" if rise > HINT else "not detected" for rise in (rises if xp is np else ())],
            rises,
            xp.where(positive, duration * (relative / 0.1) ** 2, xp.inf),
        )
        tables = {name: dict(zip(names, values, strict=False)) for name, values in zip(tables, columns, strict=True)}
        tables["presence"] |= dict.fromkeys(hints, "hint")
    noise, matrix = noise_of(terms, list(value), sinusoid), made(NamedMatrix, names=names, array=spread)
    return made(NoiseFit, noise=noise, covariance=matrix, deviation=curve, duration=duration, terms=names, **tables, **others)


def with_edf(curve: Deviation, used, edf) -> Deviation:
    """The deviation with the edf of the fitted model at the cluster sizes `used`, and with the limits that follow from them."""
    edf = np.where(used, np.maximum(edf, 1.0), curve.edf)
    low, high = interval_factors(edf, curve.confidence)
    return replaced(curve, edf=edf, lower=curve.deviation * low, upper=curve.deviation * high)
