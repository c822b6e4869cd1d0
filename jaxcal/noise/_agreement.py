"""Two estimators on one record: where they disagree, the model is wrong or the data are filtered."""

import numpy as np

from ._model import Noise
from ._result import NoiseFit

_LARGEST = 3.0


def sentences_of_difference(found: NoiseFit, other: Noise, errors: dict[str, float]) -> tuple[str, ...]:
    """Sentences on the terms that generalised least squares sees differently, for the fit of one channel.

    Two efficient estimators of one record differ by less than their standard deviations. The difference of the squared
    coefficients is compared with the larger of the two; terms that the fit does not detect or did not estimate are left out.

    Parameters
    ----------
    found : the fit.
    other : coefficients by generalised least squares.
    errors : term -> standard error of its squared coefficient there.
    """
    said = []
    for term, error in errors.items():
        index = found.terms.index(term)
        own = float(np.sqrt(found.covariance[index, index]))
        if found.verdict[term] == "not detected" or own <= 0.0:
            continue
        first, second = (float(np.asarray(noise.coefficient(term))) for noise in (found.noise, other))
        apart = abs(first**2 - second**2) / max(own, error)
        if apart > _LARGEST:
            said.append(
                f"{term} is {first:.3g} by method {found.method} and {second:.3g} by generalised least squares (SI units), {apart:.1f} "
                "standard deviations apart: the noise model does not describe this record, or the data were filtered; look at the plot"
            )
    return tuple(said)
