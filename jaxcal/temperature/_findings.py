"""Everything that a thermal model has to say: one entry for each finding."""

from .._answer import CAUTION, NOTE, Kind, table

FINDINGS = table(
    one_way=Kind(
        CAUTION, "The temperature only {moved}, so a drift in time counts as an effect of temperature, and hysteresis cannot be seen.",
        "Record the way back to the first temperature too.",
    ),
    quick=Kind(
        CAUTION, "The temperature changes so quickly that a bin of {bin:g} degC holds {held:.2g} samples; a jump needs {needed}.",
        "Change it more slowly.",
    ),
    lag_or_play=Kind(
        CAUTION, "Heating and cooling differ, but the temperature changed too evenly to tell a lag from a play.",
        "Record ramps of different speed.",
    ),
    left_out=Kind(NOTE, "{missing} of {total} samples are not numbers and {outliers} stand out from their neighbours; they are left out."),
    constant=Kind(CAUTION, "Constant in every sample: the channel is dead, and has no model."),
    refused=Kind(CAUTION, "No model: {why}"),
    untimed=Kind(NOTE, "A lag was not looked for, because the times are not known.", "Give {option.time}."),
    thermometer=Kind(NOTE, "The thermometer's noise of {noise:.2g} degC adds up to {adds:.2g} to a corrected reading, at {at:.1f} degC."),
)  # fmt: skip
