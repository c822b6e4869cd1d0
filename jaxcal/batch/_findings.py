"""Everything that the analysis of many logs has to say: one entry for each finding."""

from .._answer import CAUTION, Kind, table

FINDINGS = table(said=Kind(CAUTION, "{text}"))
FEWEST = 5  # logs that show a spread: with four, the limit of an outlier exceeds any distance that four values can have
