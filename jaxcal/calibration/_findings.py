"""Everything that a comparison of calibrations has to say, and a calibration about a log that it corrected."""

from .._answer import CAUTION, NOTE, Kind, table

FINDINGS = table(
    changed=Kind(CAUTION, "Changed: chi-square {chi:.4g} of {freedom}, probability {chance:.2g}."),
    conventions=Kind(CAUTION, "Parameters that a convention fixes differ: the two were fitted with different conventions or options."),
    outside=Kind(CAUTION, "Part of the change is in directions that neither calibration leaves open."),
    no_covariance=Kind(CAUTION, "Neither calibration has a covariance, so the significance of the change is not known."),
    one_covariance=Kind(CAUTION, "The {which} calibration has no covariance and counts as exact; the significance is too high."),
    same_recording=Kind(
        CAUTION, "Both calibrations come from the same recording, so their errors are the same; the significance is too low."
    ),
    classes=Kind(CAUTION, "The first is a {first} and the second a {second}; what only one has is not compared."),
    no_field=Kind(CAUTION, "The strength of the field is not known in one of the two, so its changes count as none."),
    turned=Kind(NOTE, "The axes turned by {angle:.3g} deg too, which the covariances of magnitudes do not know."),
    range=Kind(NOTE, "Largest difference between {low:g} and {high:g} degC of the change since the middle; it has no covariance."),
)

CORRECTED = table(
    corrected=Kind(NOTE, "Corrected with the calibration."),
    currents_taken=Kind(NOTE, "The fields of the currents {names} are taken off."),
    constant_kept=Kind(NOTE, "Brought to {reference:g} degC; the constant part of the bias is kept."),
    currents_missing=Kind(CAUTION, "The field of the currents {names} is still in the readings: they were not given.",
                          "Give them as `currents`.", terminal="Name their columns with {option.currents}."),
    not_three_axes=Kind(CAUTION, "No three axes in the log; matrix and bias are not corrected."),
    g_sensitivity=Kind(CAUTION, "The g-sensitivity is not corrected: the log has no accelerometer with three axes."),
    no_thermal_model=Kind(CAUTION, "Not corrected for temperature; the calibration has no model of it."),
    outside=Kind(CAUTION, "{percent:.3g} % of the temperatures ({least:.2f} to {most:.2f} degC) lie outside the model's {low:.2f} to "
                 "{high:.2f} degC; the value at its end is used.", "Calibrate over a wider range."),
    jump=Kind(CAUTION, "The temperature passes a jump of the bias at {centre:.2f} degC; what is left of it looks like a rate random walk."),
    same_recording=Kind(CAUTION, "The thermal model was fitted to this very recording and takes slow noise with it: K comes out too small.",
                        "Correct another recording, at a steady temperature."),
)  # fmt: skip
