"""What a file for another tool does not hold, and what in it does not come from the calibration."""

from .._answer import CAUTION, NOTE, Kind, table

FINDINGS = table(
    forced=Kind(CAUTION, "The calibration of the {part} is {verdict}, and was written all the same. {reason}"),
    applied_twice=Kind(
        CAUTION, "The device had corrected the readings of this calibration already ({applied}).",
        "Compose it with the calibration on the device first (Calibration.compose).",
    ),
    sections_left_out=Kind(
        CAUTION, "{tool} has no place for {sections}: not written.", "Correct the data with jaxcal apply before {tool} reads them."
    ),
    fields_left_out=Kind(CAUTION, "{tool} has no place for {fields} of {model}: not written."),
    matrix_left_out=Kind(CAUTION, "There is no place for {what}: not written, which costs {lost:.4g} of the reading."),
    g_sensitivity_left_out=Kind(CAUTION, "There is no place for the g-sensitivity: not written, which costs {lost:.4g} rad/s at 1 g."),
    rotation_left_out=Kind(CAUTION, "A rotation of {lost:.3g} degrees is not written.", "{place} can hold it."),
    hysteresis_left_out=Kind(CAUTION, "There is no place for lag, play and rate of change: heating and cooling will differ."),
    cubic_departs=Kind(CAUTION, "The cubic polynomial departs from the thermal model by up to {departure:.3g} {unit}{jumps}."),
    models_left_out=Kind(CAUTION, "A table holds no thermal model, only its change over the range.", "The JSON file has the model."),
    terms_left_out=Kind(
        NOTE, "There is no place for {terms}: not written.", "Give motion= to count it in N.",
        terminal="jaxcal export --for LOG counts it in N.",
    ),
    dead_axis=Kind(CAUTION, "The axis has no {term}: it may be dead. The largest value of the other axes is written."),
    limit_written=Kind(NOTE, "{term} was not found: its {limit} is written, which is safe for a filter."),
    given=Kind(NOTE, "K is the value given: {value:g} {unit}."),
    rate_estimated=Kind(NOTE, "The rate of {rate:.6g} Hz comes from the time stamps, and {use}.", "Give {option.rate} if you know it."),
    white_alone=Kind(NOTE, "K and B are not written: a covariance holds white noise alone."),
    no_covariance=Kind(NOTE, "No N was found on some axis: {name} is not written."),
    no_ageing=Kind(NOTE, "The change of the bias in {days:.3g} days is within its uncertainty: no ageing is written."),
    placeholder=Kind(NOTE, "The calibration holds no {what}: {value} is written."),
    frame_turned=Kind(
        CAUTION, "The frame of this file is turned by {angle:.4f} degrees from that of the calibration.",
        "Turn the extrinsics of cameras with it; a comment in the file has the matrix Qa.",
    ),
    estimated_by_tool=Kind(NOTE, "Biases are not written, because {tool} estimates them."),
    relearnt=Kind(NOTE, "The firmware learns the bias anew at every start unless INS_GYR_CAL is 0."),
    scale_unknown=Kind(CAUTION, "The overall scale is arbitrary, because the strength of the field was not known."),
    out_of_range=Kind(CAUTION, "The firmware does not take this {what}.", "Check the units of the log; a healthy sensor is within it."),
    reference_outside=Kind(
        CAUTION, "{reference:g} degC, at which the bias holds, is outside the thermal model ({minimum:g} to {maximum:g} degC)."
    ),
    no_bias=Kind(CAUTION, "No bias is known to go with the thermal model.", "Calibrate on the vehicle after loading this."),
    restart=Kind(NOTE, "The vehicle reads TC_A_ENABLE and TC_G_ENABLE at its start.", "Restart it after loading this."),
    recent_firmware=Kind(NOTE, "Instance {instance} exists in recent firmware alone.", "Compare the names with those of the vehicle."),
    motor_compensation=Kind(CAUTION, "Motor compensation was on in the log; old firmware adds it inside the matrix."),
)  # fmt: skip
