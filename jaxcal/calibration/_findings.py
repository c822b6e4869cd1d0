"""Everything that a comparison of calibrations has to say: one entry for each finding."""

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
