"""Verdicts, and the sentence that goes with each method's."""

import equinox as eqx
import numpy as np

from .._precision import is_traced
from .._types import Any


class Verdict(eqx.Enumeration):
    """What a method can say; `Verdict[item]` is the sentence."""

    ok = "The readings determine the answer."
    undecided = "Several roots fit the readings and nothing decides between them: give a compass azimuth as `hint`; no root is chosen."
    scale_chosen = "Two roots have a positive scale factor; the one with the scale factor nearest 1 is chosen."
    ambiguous = "The next root is closer to the chosen one than the hint is accurate; the choice may be wrong."
    clipped = "The sine or cosine asked for exceeds 1, as noise, a wrong gravity or a scale error can make it; the nearest angle is given."
    double_root = "Two roots merge here: noise moves the angle by its square root, and the standard deviation is a rough one."
    weak = "The geometry hardly determines the angle: its standard deviation exceeds 10 degrees, or it magnifies errors 50 times."
    misfit = (
        "The residuals are larger than the noise explains (p < 0.001): the table moved, a misalignment was left out, or the noise is wrong."
    )
    unobservable = "The readings do not determine every free parameter; those named have no number."
    unfinished = "The fit did not converge; start nearer to the truth, or free fewer parameters."
    integrity = "The latitude found differs from the given one by over four standard deviations: a bias, or a wrong level or latitude."
    infeasible = "No angle fits the readings: a bias or scale error, a wrong latitude or a wrong level; no azimuth is given."
    degenerate = "The readings hold no information on the angle in this geometry; no number is given."
    pole = "The latitude is within 0.1 degrees of a pole, where the Earth's rate has no horizontal part; no azimuth is given."
    missing = "A position that the method needs was not measured; no number is given."


#: verdicts that come without a number
NO_NUMBER = (Verdict.undecided, Verdict.infeasible, Verdict.degenerate, Verdict.pole, Verdict.missing, Verdict.unfinished)

_FEW = "fewer than three distinct table angles cannot tell the offset from the amplitudes: measure at a third angle, such as 90 degrees"
_MORE: dict[str, dict[str, str]] = {
    "degenerate": {
        "four_point_x": "The x axis is vertical (pitch 90 degrees): roll is not defined. The pitch stands.",
        "least_squares_x": f"Either the x axis is vertical and roll is not defined, or {_FEW}.",
        "four_point_y": "The x axis is vertical (pitch 90 degrees): roll is not defined. The pitch stands.",
        "least_squares_y": f"Either the x axis is vertical and roll is not defined, or {_FEW}.",
        "opposed": "The table's x axis is vertical: its rate does not depend on the azimuth.",
        "four_point": "Roll or pitch is 90 degrees; use 'triad', or `fit` with z readings.",
        "scale_first": "Roll or pitch is 90 degrees, or the Earth's rate lies along the table's axis; use 'triad', or `fit` with z.",
        "bias_and_scale": "The Earth's rate (or gravity) lies along the table's axis; use 'triad', or `fit` with z readings.",
        "maximum": "The table is level: the largest rate is that of the horizontal Earth's rate, whatever the azimuth and the noise; or "
        f"{_FEW}. Use 'four_point'.",
    },
    "double_root": {
        "opposed": "The x axis lies in the meridian, where 'opposed' is blind; use 'four_point', or add 90 and 270 degrees.",
        "quadrature": "The y axis lies in the meridian, where 'quadrature' is blind; use 'four_point', or add 0 and 180 degrees.",
        "maximum": "The signs of the rate along the table's axis, or two of the roots, merge; use 'four_point'.",
        "four_point_x": "Roll is 90 degrees; add a z reading and use 'bias_and_scale'.",
        "four_point_y": "Roll is 90 degrees; add a z reading and use 'bias_and_scale'.",
    },
    "infeasible": {
        "maximum": "The amplitude exceeds what the Earth's rate can give: a bias or a scale error was left in, or the level is wrong.",
        "scale_first": "No root has a positive scale factor, or none is real.",
        "bias_and_scale": "No root has a positive scale factor, or none is real.",
    },
    "undecided": {"bias_and_scale": "The roots agree in their scale factor, which cannot decide."},
}


def decided(*cases: tuple[Any, Any]) -> Any:
    """Of (condition, verdict) the verdict of the last condition that holds, or ok; conditions may be traced."""
    found = Verdict.ok
    for condition, verdict in cases:
        if is_traced(condition):
            found = Verdict.where(condition, verdict, found)
        elif bool(condition):
            found = verdict
    return found


def verdict_name(verdict: Any) -> str:
    """Name of a verdict (host only), which is an item of `Verdict`.

    Examples
    --------
    >>> from jaxcal.alignment import Verdict, verdict_name
    >>> verdict_name(Verdict.weak)
    'weak'
    """
    number = int(np.asarray(verdict._value))
    return next(name for name, item in Verdict._name_to_item.items() if int(np.asarray(item._value)) == number)


def sentence(verdict: Any, method: str) -> str:
    """What the verdict means for a method (host only)."""
    more = _MORE.get(verdict_name(verdict), {}).get(method)
    return Verdict[verdict] + (f" {more}" if more else "")
