"""`NoiseFits`: the fits of the channels of a log, as one result."""

from collections.abc import Mapping

import numpy as np

from .._answer import Results, Section
from .._errors import DataError
from .._frozen import replaced
from ._result import NoiseFit
from ._sections import SENSORS, headline_of, sections_of


class NoiseFits(Results[NoiseFit]):
    """Noise coefficients of the channels of a log: channel -> `NoiseFit`, as `characterise` returns.

    Channels are also attributes: `fits.gyro_x`. A channel named after a sensor, such as "gyro_x", has the units of data sheets.

    Parameters
    ----------
    results : channel -> `NoiseFit` of one channel.

    Examples
    --------
    >>> import jaxcal
    >>> gyro = jaxcal.noise.Noise(N=[1e-4, 1e-4, 2e-4]).simulate(5000, rate=100.0, seed=0)
    >>> fits = jaxcal.noise.characterise(jaxcal.Log(None, gyro=gyro, rate=100.0))
    >>> fits.verdict, fits.headline, fits.gyro_x.presence["N"]
    ('good', 'N to 2.9 % on every axis', 'present')
    """

    _figure = ("allan", False)

    def __init__(self, results: Mapping[str, NoiseFit]):
        if several := [name for name, fit in results.items() if np.ndim(fit.goodness)]:
            raise DataError(f"the fit of {several[0]} has several channels; NoiseFit.channel picks one", code="several_channels")
        sensor = {name: name.partition("_")[0] for name in results}
        super().__init__({name: replaced(fit, sensor=sensor[name] if sensor[name] in SENSORS else "") for name, fit in results.items()})

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
