"""Everything that `jaxcal.alignment` says about a result."""

from typing import Any

import numpy as np

from .._answer import CAUTION, FATAL, NOTE, Finding, Kind, table
from .._precision import array_module, is_traced

FINDINGS = table(
    # the answer of a method: the first of them that holds
    undecided=Kind(
        FATAL, "Several roots fit the readings and nothing decides between them.",
        "Give a rough azimuth with {option.hint}; for an unknown latitude, {option.hemisphere}, or {option.latitude} itself.",
    ),
    scale_chosen=Kind(NOTE, "Two roots have a positive scale factor; the one with the scale factor nearest 1 is chosen."),
    clipped=Kind(CAUTION, "The sine or cosine exceeds 1, by noise, a wrong gravity or a scale error; the nearest angle is given."),
    double_root=Kind(CAUTION, "Two roots merge: noise moves the angle by its square root.", "Measure a quarter turn further, too."),
    weak=Kind(CAUTION, "The geometry hardly determines the angle: its standard error exceeds 10 degrees.", limits=(np.deg2rad(10.0),)),
    misfit=Kind(
        CAUTION, "The residuals exceed the noise: the table's angles or the noise are wrong, the table moved, or a "
        "misalignment was left out. The errors are those of the residuals.", "Give {option.angle_std}.",
        limits=(0.97,),  # probability of smaller residuals: four angles off by 0.05 deg show in two of three tests, in half at 0.999
    ),
    unobservable=Kind(
        CAUTION, "The readings do not determine {names}.",
        "Give {option.priors} for one of them, hold one fixed, or measure at more angles or with mountings z and -z.",
        terminal="Give {option.prior} for one of them, hold one, or measure at more angles or with mountings z and -z.",
    ),
    unfinished=Kind(FATAL, "The fit did not converge.", "Start nearer to the truth, or free fewer parameters."),
    integrity=Kind(CAUTION, "The latitude found is over four standard deviations off the given one: a bias, wrong level or latitude."),
    infeasible=Kind(FATAL, "No angle fits the readings: a bias or scale error, a wrong latitude or a wrong level."),
    degenerate=Kind(
        FATAL, "The readings hold no information on the angle in this geometry.",
        "Measure at three distinct table angles or more, or remount the sensor along z and use jaxcal.alignment.fit.",
    ),
    pole=Kind(FATAL, "The latitude is within 0.1 deg of a pole: the Earth's rate has no horizontal part.", limits=(np.deg2rad(89.9),)),
    missing=Kind(FATAL, "A position that the method needs was not measured."),
    # the joint fit
    noise_from_residuals=Kind(
        NOTE, "No noise was given: the residuals gave a level of white noise. The intervals do not allow for a bias that wanders.",
        "Give {option.noise}.", terminal="Give {option.noise}, {option.gyro} or {option.accel}.",
    ),
    nominal_noise=Kind(
        NOTE, "Nothing is left to estimate the noise from: it is that of a nominal sensor (50 micro-g sqrt(s), 0.01 deg/sqrt(h)).",
        "Give {option.noise}, or measure at more angles.",
    ),
    unchecked=Kind(NOTE, "There are as many parameters as readings: nothing checks the fit."),
    prior_alone=Kind(NOTE, "From the prior alone: {names}."),
    mirrored=Kind(NOTE, "Without a z reading, a table upside down (180 deg less the roll, minus the azimuth) fits, too; it is ruled out."),
    drift=Kind(
        CAUTION, "The bias drifts by {size} during the test. The fit includes it; without, the azimuth would be off by {change}.",
        "Let it warm up.", limits=(1e-3,),  # probability of such a drift by chance
    ),
    drift_open=Kind(
        FATAL, "The bias drifts, and these readings cannot tell the drift from the azimuth.",
        "Measure each position twice, there and back, or let the gyro warm up.",
    ),
    tilt=Kind(
        CAUTION, "The base tilts by {tilt} during the test. The fit includes it; without, roll and pitch would be off by {change}. "
        "They hold for the middle of the test.",
    ),
    drift_order=Kind(
        NOTE, "The azimuth changes by up to {size:.2g} for each deg/h by which the gyro's bias changes in the test.",
        "Measure in the order {order} deg, and all that back.", limits=(1.2,),  # times the change with that order
    ),
    angles_open=Kind(
        NOTE, "The intervals allow for errors of the table's angles. With exact angles they would be ± {azimuth:.2g} of the azimuth, "
        "± {level:.2g} of roll and pitch.", "Give {option.angle_std}, 0 for exact ones.", limits=(2**0.5,),  # times those with exact angles
    ),
    # the raw log of a table
    rests=Kind(NOTE, "{count} rests of {least:.4g} to {most:.4g} were found, at {angles} deg.", guess=True),
    angles_of_gyro=Kind(
        NOTE, "The table's angles come from the gyroscope, with a scale error of {ppm:.3g} ppm.", "Give {option.angles}, if they are known "
        "better.", guess=True,
    ),
    angle_turned=Kind(NOTE, "The table's angle grows against the rotation about the axis down; its sign was turned.", guess=True),
    axis_tilted=Kind(
        NOTE, "The table turns about an axis {tilt:.3g} off the device's z axis; the readings were turned into its frame.",
        limits=(np.deg2rad(0.5),),
    ),
)  # fmt: skip

#: the answer of a method as a number that JAX can trace: its place here; the last of them come without a number
OUTCOMES = (
    "ok", "scale_chosen", "clipped", "double_root", "weak", "misfit", "unobservable", "integrity",
    "unfinished", "undecided", "infeasible", "degenerate", "pole", "missing",
)  # fmt: skip
_FIRST_WITHOUT = OUTCOMES.index("unfinished")


def decided(*cases: tuple[Any, str]) -> Any:
    """Number of the last outcome whose condition is true, or of "ok"; conditions may be traced."""
    found: Any = 0
    for condition, code in cases:
        number = OUTCOMES.index(code)
        found = array_module(condition).where(condition, number, found) if is_traced(condition) else number if bool(condition) else found
    return found


def has_number(outcome: Any) -> Any:
    """Whether there is an answer, for outcomes of any shape."""
    return outcome < _FIRST_WITHOUT


def findings_of(outcome: Any, subject: tuple[str, ...] = (), **facts: Any) -> tuple[Finding, ...]:
    """The finding of an outcome, none for "ok" (host only)."""
    code = OUTCOMES[int(outcome)]
    return () if code == "ok" else (FINDINGS(code, subject, **facts),)
