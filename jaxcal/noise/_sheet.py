"""Noise coefficients from the words of a data sheet."""

import math
import re

from .._answer import Message
from .._errors import UnitError
from .._units import find_unit, noise_units, units_of
from ._model import Noise

#: spelling of data sheets -> that of the table of units, in this order
_SPELLINGS = (
    (r"[µμ]", "u"), (r"[°º]|degrees?\b", "deg"), (r"√\s*\(?(hz|hr|h|s)\b\)?", r"sqrt(\1)"), (r"/?\s*\b(?:rt|root)[ -]?hz", "/sqrt(hz)"),
    (r"(hz|hr|h|s)\^(?:0\.5|\(1/2\))", r"sqrt(\1)"), (r"\bhr\b|hours?\b", "h"), (r"\bsec\b", "s"), (r"\b(m?)dps\b", r"\1deg/s"),
    (r"/h\^?(?:1\.5|\(3/2\))", "/h/sqrt(h)"), (r"²", "^2"), (r"(deg/s|deg)[ -]*rms", r"\1 rms"),
)  # fmt: skip
_ITEM = re.compile(r"(?P<words>[a-z :-]*?)[<~≤ ]*(?P<value>[\d.]+(?:e-?\d+)?)\s*(?P<unit>[a-z/()^0-9]+)(?P<rms> rms)?"
                   r"(?: (?:in|at|over|@) ?(?P<band>[\d.]+) ?hz)?(?: rms)?(?: typ(?:ical)?)?")  # fmt: skip
#: lowest Allan deviation of flicker over B, which data sheets give as in-run bias instability
_FLOOR = math.sqrt(2 * math.log(2) / math.pi)


def read_sheet(text: str) -> tuple[dict[str, Noise], list[str]]:
    """Noise by sensor from such as "gyro: ARW 0.3 deg/sqrt(h), BI 2 deg/h; accel: 60 ug/sqrt(Hz)", and how each number was converted."""
    found: dict[str, dict[str, float]] = {}
    said = []
    for item in re.split(r"[;,]", text):
        plain = " ".join(item.lower().split())
        for pattern, new in _SPELLINGS:
            plain = re.sub(pattern, new, plain)
        sensor, term, value, how = _converted(plain, item.strip())
        found.setdefault(sensor, {})[term] = value
        said.append(f"{item.strip()}: {sensor} {term} = {value:.4g} {noise_units(term, sensor)[-1]}, {how}")
    return {sensor: Noise(**terms) for sensor, terms in found.items()}, said


def _converted(plain: str, item: str) -> tuple[str, str, float, str]:
    """Sensor, term, SI value and how it was made, of one item."""
    matched = _ITEM.fullmatch(plain.strip())
    root = matched and re.fullmatch(r"\(?(.+?)\)?/sqrt\((hz|h|s)\)", matched["unit"])
    if matched is not None:
        value, (base, per) = float(matched["value"]), (root[1], root[2]) if root else (matched["unit"], "")
        scale = {"h": 60.0}.get(per, 1.0)
        for sensor, integral in (("gyro", "angle"), ("accel", "speed")):
            if per in ("h", "s") and (unit := find_unit(base, integral)):
                return sensor, "N", value * units_of(integral)[unit] / scale, "a random walk"
            if unit := find_unit(base, sensor):
                size = value * units_of(sensor)[unit]
                if per == "hz":
                    return sensor, "N", size / math.sqrt(2), "from a one-sided density, over sqrt(2)"
                if per:
                    return sensor, "K", size / scale, "a random walk of the bias"
                if matched["band"]:
                    return sensor, "N", size / math.sqrt(2 * float(matched["band"])), "from an rms, over sqrt(2 bandwidth)"
                if not matched["rms"]:
                    return sensor, "B", size / _FLOOR, "from the lowest Allan deviation, which is 0.664 B"
    raise UnitError(Message("{item}: expected such as 0.3 deg/sqrt(h), 60 ug/sqrt(Hz), 2 deg/h, or 0.05 deg/s rms in 92 Hz", item=item),
                    code="sheet")  # fmt: skip
