"""Everything that `jaxcal.imu` says about a result."""

import numpy as np

from .._answer import CAUTION, FATAL, GRAVITY_ASSUMED, NOTE, WRONG_RANGE, Kind, table

_LACK = "The {what} show {term} of {size:.2g} at {at:.3g}, which moves the matrix by {matrix}; the intervals include it."
_ADD = "Add it with {option.terms:auto}."

FINDINGS = table(
    gravity_assumed=GRAVITY_ASSUMED,
    range=WRONG_RANGE,
    # the recording
    unit=Kind(
        FATAL, "The accelerometer reads {size:.3g} at rest, where {gravity:.4g} m/s^2 is expected: its readings look like {unit}.",
        "Give {option.units:accel={unit}}."
    ),
    unit_unknown=Kind(
        FATAL, "The accelerometer reads {size:.3g} at rest, where {gravity:.4g} m/s^2 is expected.",
        "Give its unit with {option.units:accel=UNIT}, or {option.raw:True} for counts.",
        terminal="Give its unit with {option.units:accel=UNIT}, or --counts."
    ),
    few_rests=Kind(
        FATAL, "There are {count} still intervals; the model needs {needed}, and 18 to 24 are advised.",
        "Hold the sensor still for 3 s on each face and edge, and on some corners. For a block on its six faces, use jaxcal.imu.ferraris.",
        terminal="Hold the sensor still for 3 s on each face and edge, and on some corners. For a block on its six faces, "
        "give --method six_position."
    ),
    turns_lost=Kind(
        NOTE, "{lost} turns were left out: in them more readings are missing, or at the end of the range, than can be interpolated.",
        "Turn more slowly."
    ),
    dead_band=Kind(
        CAUTION, "At rest the gyroscope reads exact zeros, a dead band of {size:.2g}: its bias is known to this only.",
        "Switch the dead band off."
    ),
    gyro_dead=Kind(CAUTION, "An axis of the gyroscope never changes: the accelerometer is calibrated without the turns."),
    few_turns_left=Kind(FATAL, "{kept} turns are left; a gyroscope needs 6."),
    # what poses and turns determine
    attitudes_enough=Kind(NOTE, "The {poses} poses determine every parameter; least certain: {what}."),
    attitudes=Kind(
        CAUTION, "The {poses} poses {degree} {what} (condition number {condition:.3g}).", "Add poses with {missing}.",
        limits=(12.0, 300.0),  # 18 evenly spread poses have 3 to 4; with more than the second number the fit is singular
    ),
    attitudes_alike=Kind(FATAL, "The {poses} poses are all alike, within {spread:.2g} of one attitude.", "Add poses with {missing}."),
    gyro_open=Kind(
        FATAL, "The turns do not determine the gyroscope.",
        "Turn by 45 to 180 degrees about several horizontal axes; a turn about the vertical tells nothing."
    ),
    parameters_open=Kind(FATAL, "{what}"),
    poor=Kind(
        CAUTION, "The matrix is known to {error} only.", "Add poses, with turns of 45 to 180 degrees about other axes between them.",
        limits=(0.01, 0.1),  # largest standard error, relative to the scale; with more than the second number the matrix is unknown
    ),
    few_poses=Kind(CAUTION, "There are {poses} poses; 18 to 24 are advised.", limits=(-12.0,)),  # 9 poses leave nothing to check the fit
    # the fit
    failed=Kind(FATAL, "The fit failed: {why}"),
    turns_disagree=Kind(
        FATAL, "After a turn, the verticals of gyroscope and accelerometer differ by {angle:.1f} rms: wrong axes or unit.",
        limits=(np.deg2rad(5.0),),  # more than scale factors of some per cent cause
    ),
    gyro_unit=Kind(FATAL, "The turns fit if the gyroscope is in {unit}.", "Give {option.units:gyro={unit}}."),
    gyro_axes=Kind(
        FATAL, "Compared with the accelerometer, {what}: x, y, z of the device are {axes} of the gyroscope.",
        "Give {option.axes:gyro={axes}}."
    ),
    prior_conflict=Kind(CAUTION, "The prior contradicts the recording (p = {level:.1g}): the device has changed, or it is another one."),
    disagree=Kind(CAUTION, "{count} of {total} {what} do not agree with the others: the sensor was bumped, or moved in another way.",
                  limits=(0.2,)),
    held_out=Kind(
        CAUTION, "The {what} that were left out of the fit are off by {size:.2g}, {ratio:.0f} times as much as those in it.",
        "Add poses with turns of 45 to 180 degrees about other axes between them, and check the range of the gyroscope.",
        limits=(10.0, 50.0),  # times; 18 plain poses have 3.1 at most, 24 have 1.4, three public logs 1.8, and a clipped gyroscope 87
    ),
    scatter=Kind(CAUTION, "The magnitudes scatter by {sigma:.2g}: the sensor moved while it should rest, or is not linear.", limits=(0.2,)),
    scatter_unexplained=Kind(
        CAUTION, "The magnitudes scatter {ratio:.2g} times as much as the noise inside the rests: by a drift, a motion or a nonlinearity.",
        "Hold the sensor still in 18 to 24 attitudes, which show the cause.",
        limits=(2.0,),  # times the noise; flicker noise alone can cause less
    ),
    lack_accel=Kind(CAUTION, _LACK, _ADD),
    lack_gyro=Kind(CAUTION, _LACK, _ADD),
    lack_memory=Kind(CAUTION, _LACK, "Approach each pose from the same side, and rest longer."),
    memory_possible=Kind(
        CAUTION, "The {what} hint at {term} of {size:.2g}, which would move the matrix by {matrix}: the intervals include it in part.",
        "Take 24 poses, each from the same side, and rest longer.",
        limits=(3.0,),  # times: 3 of 100 plain recordings of 12 poses, 2 of 100 of 24, and 91 of 100 with a creep of 0.05 % in 12 poses
    ),
    memory_open=Kind(
        NOTE, "The {what} cannot exclude {term} of up to {size:.2g}, which would move the matrix by {matrix}, and a number by {ratio:.0f} "
        "stated errors.",
        "Take more poses, each from the same side, and rest longer.",
        limits=(3.0,),  # stated errors, which the largest of 24 errors seldom exceeds
    ),
    lack_drift=Kind(
        CAUTION, "The {what} show {term} of {size:.2g} in all, which moves the matrix by {matrix}; the intervals include it.",
        "Let the sensor warm up first, or add the drift with {option.terms:auto}."
    ),
    lack_step=Kind(
        CAUTION, "The {what} show a step of {size:.2g} after pose {pose}, at {time:.3g}, which moves the matrix by {matrix}; the "
        "intervals include it.", "Calibrate the parts before and after it alone."
    ),
    terms_added=Kind(NOTE, "The log asked for {terms}, which the model now has."),
    drift=Kind(NOTE, "The bias drifts by {size:.2g} over {time:.3g}; the result is that of the middle, its interval that of all times."),
    warm_up=Kind(NOTE, "The bias warms up by {size:.2g} during the recording; the result is the settled one."),
    no_g_sensitivity=Kind(NOTE, "The gyroscope shows no sensitivity to specific force (p = {level:.2g}), and the fit leaves it out."),
    delay=Kind(
        NOTE, "The gyroscope is {delay:.2g} {side} than the accelerometer, to {half:.2g}; a filter of both must know it.", limits=(1e-3,),
    ),
    # sessions, positions, tables and shakers
    box=Kind(CAUTION, "The faces disagree by {tilt:.2g}: the box was not square or did not lie flat."),
    no_misalignment=Kind(
        NOTE, "The faces show no misalignment beyond the errors of their levels, {tilt:.2g} (p = {level:.2g}), and the fit leaves it out."
    ),
    turned_once=Kind(NOTE, "Each turn was made once, so an error of its angle is an error of the scale.", "Repeat the turns to see it."),
    sigma_too_small=Kind(
        CAUTION, "The readings scatter by {ratio:.2g} times the noise given, by levelling, repeatability or the model.",
        "Leave out {option.sigma}, else the intervals are too narrow."
    ),
    axes_exchanged=Kind(
        CAUTION, "The axes of the sensor are not those of the positions: some are exchanged.", "Check the order of the readings."
    ),
    one_way=Kind(CAUTION, "The axes {axes} were not turned in both directions, so there is no matrix."),
    no_repeats=Kind(CAUTION, "No rate was set twice, so the intervals know only the noise inside a stretch.", "Set some rates again."),
    faces=Kind(NOTE, "The faces up do not separate a g-sensitivity from the bias.", "Turn with each of the six faces up to measure it."),
    delay_unsure=Kind(CAUTION, "The delay is known to {half:.2g} only, more than a sample.", "Turn faster, and more often."),
)  # fmt: skip
