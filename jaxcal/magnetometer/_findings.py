"""Everything that a magnetometer calibration has to say: one entry for each finding."""

import numpy as np

from .._answer import CAUTION, FATAL, NOTE, Kind, table

AGREE = np.deg2rad(5.0)  # difference of two dips that are each true to a few degrees

FINDINGS = table(
    # no calibration
    few=Kind(FATAL, "There are {count} distinct readings; the model {model} needs {least}.", "Turn the sensor through more attitudes."),
    line=Kind(FATAL, "The readings lie on a line.", "Turn the sensor through all attitudes."),
    near_planar=Kind(
        FATAL, "The readings are near-planar: the field across their plane stays open.",
        "Turn the sensor about a second axis, or give {option.model:planar}.",
    ),
    no_ellipsoid=Kind(FATAL, "The readings lie on no ellipsoid.", "Turn the sensor through more attitudes."),
    undetermined=Kind(
        FATAL, "The readings do not determine {what}.", "Turn the sensor about a second axis, and tilt it further.",
        limits=(1e8,),  # condition number, 3 for even coverage, at which a combination is lost in rounding
    ),
    not_converged=Kind(FATAL, "The fit did not converge; least certain is {what}.", "Turn the sensor through more attitudes."),
    # the heading error, or how well it is known
    heading=Kind(
        CAUTION, "The heading error is above {limit:.2g}.", "Read next: {attitude}.",
        limits=(float(np.deg2rad(1.0)), float(np.deg2rad(5.0))),  # rms, rad: what a compass needs; no use as one
    ),
    few_left=Kind(CAUTION, "{count} readings leave the noise uncertain: the heading error may be {angle:.2g}.", "Take more readings."),
    small_model=Kind(
        CAUTION, "The readings cannot show {what}; the model {model} was fitted, and what it leaves out may be there.",
        "Turn the sensor through more attitudes.",
    ),
    plane=Kind(CAUTION, "The readings were fitted in their plane: headings hold in that plane only."),
    # readings
    scatter=Kind(
        CAUTION, "The readings scatter by {share:.0f} % of the field about the best surface.",
        "Keep iron, motors and cables away, and check the axes of the log.",
        limits=(0.1, 0.2),  # of the field: errors of first order become wrong; the readings lie on no surface
    ),
    outliers=Kind(
        CAUTION, "{count} of {total} readings are outliers.", "Keep iron and motors away, and check the wires.",
        limits=(0.1, 0.4),  # share of them: with up to a tenth, the fit of four accurate real logs was right; the rest is no majority
    ),
    field_differs=Kind(
        NOTE, "The readings have a mean field of {found:.4g}, the given one is {given:.4g}.",
        "Check the unit of the readings, and {option.field}.",
        limits=(0.22,),  # logarithm of the ratio: a sensitivity is true to 10 %, so that the unit is wrong
    ),
    clipped=Kind(
        NOTE, "{count} readings stand at the end of the range of an axis, and are left out.", "Use a larger range of the sensor."
    ),
    # what the residuals follow
    follows=Kind(
        NOTE, "The hard iron follows {what}, by up to {size:.2g} % of the field.", "Keep it constant, or give {option.currents}.",
        terminal="Keep it constant, or fit its field with {option.currents:{what}}.",
    ),
    averaged=Kind(
        NOTE, "The readings fall short where the sensor turns fast, by up to {size:.2g} % of the field.",
        "Turn more slowly, or record without the filter.",
    ),
    bent=Kind(NOTE, "The response of an axis is bent, by up to {size:.2g} % of the field.", "Use a larger range of the sensor."),
    correlated=Kind(NOTE, "The residuals, {size:.2g} % of the field, are correlated along the log; the errors allow for it."),
    # the rotation against another sensor
    delay_open=Kind(
        NOTE, "The turns do not show the delay between the sensors.", "Turn with a rate that varies.",
        limits=(0.025,),  # s, standard deviation: half of the prior's
    ),
    dip_differs=Kind(
        CAUTION, "The dip is {found:.1f} by the accelerometer, {given:.1f} by the given field.", "Check place and date, or keep iron away.",
        limits=(AGREE,),
    ),
    aid_off=Kind(
        CAUTION, "Readings lie {angle:.2g} from where they should lie by the {source}.",
        "Check times, axes, signs and unit; hold the sensor still in each attitude, and give magnetic headings, clockwise from north.",
        limits=(float(np.deg2rad(2.0)),),  # it costs twice the limit of a good fit
    ),
    # the axes
    axes_open=Kind(
        FATAL, "The magnetometer's axes are {first} of the other sensor with dip {dip:.0f}, or {second}, mirrored, with {other:.0f}.",
        "Give {option.inclination}: the sign of the dip decides.",
    ),
    axes_turned=Kind(
        FATAL, "The magnetometer's axes are {first} of the gyroscope, or mirrored: {second}. Rates cannot tell which.",
        "Use an accelerometer with {option.inclination}, or known headings.",
    ),
    mirrored=Kind(
        FATAL, "The magnetometer is mirrored: {what}. Its x, y, z are {axes} of the other sensor.", "Give {option.axes:mag={typed}}.",
    ),
    remounted=Kind(NOTE, "The magnetometer's axes x, y, z are {axes} of the accelerometer; the result has those of the accelerometer."),
    reversed=Kind(
        CAUTION, "The dip is {dip:.0f}, of the wrong sign: the accelerometer reports gravity, or all axes are reversed.",
        "Negate the accelerometer: specific force points up at rest.",
    ),
    unseen_axes=Kind(NOTE, "The readings do not show whether axes are mirrored.", "Turn clockwise at level: the heading must rise."),
    # along a long log
    drifts=Kind(
        CAUTION, "The hard iron drifts by {percent:.2g} % of the field in an hour; one calibration for the log costs {angle:.2g}.",
        "Calibrate again every {hours:.2g} h.",
    ),
    disturbed=Kind(
        CAUTION, "The readings vary along the log, but a drift of the hard iron does not predict the parts that were left out.",
        "Keep iron and motors away, and move less from place to place.",
    ),
    steady=Kind(NOTE, "No drift of the hard iron shows: one calibration holds for the log."),
    # beside the present calibration
    changed=Kind(
        NOTE, "Level headings turn by {rms:.2g} rms against {file}, {most:.2g} at most; the hard iron moves by {moved:.3g}.",
        "Replace that calibration.",
    ),
    unchanged=Kind(
        NOTE, "Level headings turn by {rms:.2g} rms against {file}, no more than the new one is uncertain by.", "Keep that calibration."
    ),
    # notes
    dip_assumed=Kind(
        NOTE, "The heading error assumes a dip of {dip:.0f}.", "Give {option.inclination}, or record an accelerometer beside."
    ),
    not_judged=Kind(NOTE, "The fit was traced: nothing was chosen, and nothing is judged.", "Call `fit` outside of jit, vmap and grad."),
    contradicts=Kind(
        CAUTION, "The readings have a field of {found:.4g}, {given:.4g} was given, more apart than the errors of both.",
        "Check {option.field}, and its error.",
        limits=(3.0,),  # standard errors: 0.3 % by chance
    ),
    check=Kind(
        CAUTION, "The {count} readings checked are off by more than the fit predicts.",
        "Look for an error in the calibration, in these readings or in their known headings.",
    ),
)  # fmt: skip
