"""Everything that the analysis of many logs has to say: one entry for each finding."""

from .._answer import CAUTION, FATAL, NOTE, Kind, table

FINDINGS = table(
    stuck=Kind(
        FATAL, "The draws hardly moved: the values are not to be trusted.", "Leave out terms or covariates.",
        limits=(0.95,),  # share of the proposals that are refused
    ),
    odd=Kind(NOTE, "{device} is odd in {term}: a usual device is as far from the middle in {percent:.2g} % of cases."),
    same=Kind(NOTE, "{name} is the same in all logs, and is left out of the covariates."),
    said=Kind(CAUTION, "{text}"),
)  # fmt: skip
FEWEST = 5  # devices or logs that show a spread: with four, the limit of an outlier exceeds any distance that four values can have
