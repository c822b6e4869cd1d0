"""Everything that the analysis of many logs has to say: one entry for each finding."""

from .._answer import CAUTION, FATAL, NOTE, Kind, table

FINDINGS = table(
    drift=Kind(CAUTION, "{term} drifts by {size:+.3g}{unit} over the line (chance {chance:.1g})."),
    change=Kind(CAUTION, "{term} changes by {size:+.3g}{unit} from {first} on (chance {chance:.1g})."),
    stuck=Kind(FATAL, "The draws hardly moved: the values are not to be trusted.", "Leave out terms or covariates."),
    odd=Kind(NOTE, "{device} is odd in {term}: a usual device is as far from the middle in {percent:.2g} % of cases."),
    same=Kind(NOTE, "{name} is the same in all logs, and is left out of the covariates."),
    said=Kind(CAUTION, "{text}"),
)
