"""What a budget says beside its numbers."""

import math

from .._answer import CAUTION, NOTE, Kind, table

FINDINGS = table(
    no_noise=Kind(CAUTION, "No noise of the {sensor} is known: its part is missing in every number.", "Give its noise, or a data sheet."),
    exact=Kind(
        NOTE, "No errors of {what} are known: they count as zero.", "Calibrate it, or give {option.errors}.",
        terminal="Calibrate it, or give --error, as gyro.scale=1e-3.",
    ),
    large_angles=Kind(
        CAUTION, "The attitude error reaches {angle:.3g}, where errors no longer add up.", limits=(math.radians(10),),
        # sine and angle differ by 0.5 % there
    ),
)  # fmt: skip
