"""Verdict, reason and warnings of a device fit."""

from typing import Any

import numpy as np

from .._units import STANDARD_GRAVITY
from ._axes import named

#: largest standard errors of a good sensor: of its matrix (1 or rad), and of its bias in SI (hard iron: as a fraction of the field)
_GOOD = {"accel": (5e-3, 5e-3 * STANDARD_GRAVITY), "gyro": (5e-3, np.deg2rad(0.02)), "magnetometer": (1e-2, 5e-3)}
_MOTIONS = {
    "accel": "tilt the device through all attitudes, and rest it in several",
    "gyro": "turn it about all three of its axes",
    "magnetometer": "turn it about all three of its axes, through all attitudes",
}
_TITLES = {"accel": "accelerometer", "gyro": "gyroscope", "magnetometer": "magnetometer"}
_SLOW = 40.0  # Hz; below it, the noise of the readings includes the tremor of the hand
_WIDE = 1.5  # m from the mean position: a hand with a reach of 0.25 m along each axis goes 1.1 m away in three minutes


def sensor_of(name: str) -> str:
    """Sensor to which a parameter belongs. Field, dip and the second delay belong to the magnetometer."""
    first = name.partition(".")[0]
    return {"gyro_delay": "gyro", "lever": "accel"}.get(first.partition("[")[0], first if first in _GOOD else "magnetometer")


def _grouped(names: list[str]) -> str:
    """Names, with the entries of each matrix or vector joined: gyro.matrix[0,0 0,1]."""
    fields: dict[str, list[str]] = {}
    for name in names:
        field, _, entry = name.partition("[")
        fields.setdefault(field, []).append(entry.rstrip("]"))
    return ", ".join(field + (f"[{' '.join(entries)}]" if entries[0] else "") for field, entries in fields.items())


def judged(facts: dict[str, Any]) -> tuple[str, str, tuple[str, ...], dict[str, str]]:
    """Verdict, reason, warnings, and the verdict on each sensor."""
    names, error = facts["names"], np.sqrt(np.diag(facts["covariance"]))
    verdicts, sentences, warnings = {}, [], []
    for sensor, (matrix, bias) in _GOOD.items():
        lost = [name for name in facts["undetermined"] if sensor_of(name) == sensor]
        own = [i for i, name in enumerate(names) if sensor_of(name) == sensor and name not in lost]
        kinds = {"matrix": [], "bias": []}
        for i in own:
            what = names[i].partition(".")[2].partition("[")[0]
            kind = {"matrix": "matrix", "soft_iron": "matrix", "bias": "bias", "hard_iron": "bias"}.get(what)
            if kind:
                kinds[kind].append(error[i] / (facts["field"] if what == "hard_iron" else 1.0))
        worst = [max(kinds["matrix"], default=0.0), max(kinds["bias"], default=0.0)]
        verdicts[sensor] = "refused" if lost else "good" if worst[0] <= matrix and worst[1] <= bias else "weak"
        title = _TITLES[sensor]
        if lost:
            what = "any parameter" if not own else _grouped(lost)
            sentences.append(f"The motion does not show {what} of the {title}: {_MOTIONS[sensor]}.")
        elif verdicts[sensor] == "weak":
            sentences.append(
                f"Standard errors of the {title} reach {100 * worst[0]:.2g} % (matrix) and {_bias(sensor, worst[1])} (bias): record "
                f"longer, and {_MOTIONS[sensor]}."
            )
    for sensor, axes in zip(("gyro", "magnetometer"), facts["axes"], strict=True):
        if not np.array_equal(axes, np.eye(3)):
            warnings.append(
                f"The axes of the {_TITLES[sensor]} are not those of the accelerometer: {named(axes, 'accelerometer')}. The "
                "calibration contains this rotation."
            )
    if facts["rate"] < _SLOW:
        warnings.append(
            f"At {facts['rate']:.3g} Hz, the noise of the readings cannot be told from the tremor of the hand, so the intervals are too "
            "wide: record at 50 Hz or more."
        )
    away = np.linalg.norm(facts["place"] - facts["place"].mean(axis=0), axis=1).max()
    if away > _WIDE:
        warnings.append(
            f"The device went {away:.2g} m away from its mean position. The errors of the accelerometer assume that it stays within "
            "an arm's reach: stand still and move only the arm."
        )
        verdicts["accel"] = "refused" if verdicts["accel"] == "refused" else "weak"
    for lack in facts["lacks"]:
        if lack.name == "drift":
            warnings.append(
                f"The gyroscope's bias drifted by {np.rad2deg(lack.size) * 3600:.2g} deg/h along the recording "
                f"(p = {max(lack.level, 1e-300):.1g}): the bias and its error are those of the mean over the recording. Let the device "
                "warm up before you record."
            )
            continue
        verdicts["magnetometer"] = "refused" if verdicts["magnetometer"] == "refused" else "weak"
        if lack.name == "gradient":
            warnings.append(
                f"The field varies with the place, by {100 * lack.size:.2g} % per metre (p = {max(lack.level, 1e-300):.1g}): record "
                "farther from iron, or move the device less."
            )
        else:
            warnings.append(
                f"The magnetometer turns against the other sensors, by {np.rad2deg(lack.size):.2g} degrees rms, as the device accelerates "
                f"(p = {max(lack.level, 1e-300):.1g}): mount it firmly."
            )
    if facts["disturbed"]:
        spans = ", ".join(f"{a:.1f} to {b:.1f} s" for a, b in facts["disturbed"][:6])
        more = f" and {len(facts['disturbed']) - 6} more" if len(facts["disturbed"]) > 6 else ""
        warnings.append(f"The field was disturbed from {spans}{more}; the fit gives these stretches little or no weight.")
        if sum(b - a for a, b in facts["disturbed"]) > 0.2 * facts["duration"]:
            verdicts["magnetometer"] = "refused" if verdicts["magnetometer"] == "refused" else "weak"
    if np.isfinite(facts["freedom"]):
        warnings.append(
            f"Parts of the recording disagree {np.sqrt(facts['disagreement']):.2g} times as much as noise explains: the errors come from "
            "fits that leave out one part after another."
        )
    if not (facts["converged"] or facts["undetermined"]):
        verdicts = dict.fromkeys(verdicts, "refused")
        sentences.insert(0, "The fit did not converge, so its numbers are not reliable: record again, far from iron.")
    order = ("good", "weak", "refused")
    verdict = max(verdicts.values(), key=order.index)
    good = [_TITLES[sensor] for sensor, word in verdicts.items() if word == "good"]
    if verdict == "good":
        sentences.append("The recording determines all three sensors.")
    elif not sentences:
        doubtful = " and ".join(_TITLES[sensor] for sensor, word in verdicts.items() if word != "good")
        sentences.append(f"The {doubtful} may be wrong by more than the intervals say: see the warnings.")
    elif good:
        sentences.append(f"The {' and '.join(good)} {'is' if len(good) == 1 else 'are'} good.")
    return verdict, " ".join(sentences), tuple(warnings), verdicts


def _bias(sensor: str, value: float) -> str:
    if sensor == "accel":
        return f"{1e3 * value / STANDARD_GRAVITY:.2g} mg"
    return f"{np.rad2deg(value):.2g} deg/s" if sensor == "gyro" else f"{100 * value:.2g} % of the field"
