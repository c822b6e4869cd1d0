"""What the package says about a deviation."""

from .._answer import CAUTION, NOTE, Kind, table
from .._log_findings import LOG

FINDINGS = table(
    uneven=LOG["uneven"],
    longest_stretch=Kind(
        CAUTION,
        "{kind} needs a record without gaps: only its longest stretch was used, {share:.0%} of it, samples {start} to {stop}.",
        "For all of it take {option.kind:oadev}.",
    ),
    no_difference=Kind(NOTE, "No difference without gaps at tau = {tau}, which is left out."),
    empty=Kind(CAUTION, "Nothing but NaN: no deviation."),
    not_followed=Kind(NOTE, "Parts were merged without {option.start}: tau = {tau} cannot be followed any more."),
    ends_early=Kind(NOTE, "{kind} of a record longer than {option.chunk:{chunk}} ends at cluster size {exact}.", "Raise {option.exact}."),
)


def times(tau, most: int = 5) -> str:
    """Cluster times for a sentence, with their unit; the first, the last and the number of many."""
    words = [f"{each:g}" for each in tau]
    return f"{', '.join(words)} s" if len(words) <= most else f"{words[0]} to {words[-1]} s ({len(words)} values)"
