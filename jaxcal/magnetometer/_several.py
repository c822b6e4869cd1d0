"""`fit_several`: several magnetometers on one body."""

from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from ._fit import fit
from ._model import MagModel
from ._result import MagFit
from ._rotation._align import array


def fit_several(readings: dict[str, Any], **options: Any) -> dict[str, MagFit]:
    """Several magnetometers on one body, read at the same times: each calibrated, and all turned into the axes of the first.

    Parameters
    ----------
    readings : name -> (n, 3), rows at the same times.
    options : those of `fit`. The `aid` is that of the first sensor: its rotation is found once, and holds for all.

    Returns
    -------
    name -> `MagFit`; the models of all but the first give fields in the axes of the first, as far as their own shape tells.

    Raises
    ------
    DataError
        If lengths differ, or a sensor has no model.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import MagModel, body_field, fit_several, scenario
    >>> h = body_field(scenario("all"), 50.0)
    >>> turned = MagModel(np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.ones(3))
    >>> fits = fit_several({"mast": h, "board": turned.measure(h)})
    >>> print(np.abs(fits["board"].model.correct(turned.measure(h)) - h).max() < 1e-6)
    True

    References
    ----------
    G. Wahba, SIAM Review 7 (1965) 409 (the rotation, by singular values).
    """
    # not a host driver itself: those hand dictionaries on in alphabetical order, and the first sensor matters
    arrays = {name: array(m, f"readings of {name}") for name, m in readings.items()}
    if not arrays or len({len(m) for m in arrays.values()}) > 1:
        raise DataError(f"The sensors have {[len(m) for m in arrays.values()]} readings; give rows at the same times for all.")
    aid = options.pop("aid", None)
    found: dict[str, MagFit] = {}
    reference = None
    for name, m in arrays.items():
        one = fit(m, **options, aid=aid if reference is None else None)
        if one.model is None:
            raise DataError(f"{name}: {one.reason}")
        y = np.asarray(one.model.correct(m)) / one.field
        if reference is None:
            reference = y
        else:
            left, _, right = np.linalg.svd(y.T @ reference)
            rotation = left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right
            model = MagModel(np.asarray(one.model.soft_iron) @ rotation, one.model.hard_iron)
            one = eqx.tree_at(lambda f: f.model, one, model)
        found[name] = one
    return found
