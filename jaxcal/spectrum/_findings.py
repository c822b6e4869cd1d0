"""What the package says about a spectrum."""

from .._answer import CAUTION, NOTE, Kind, table
from .._log_findings import LOG

FINDINGS = table(
    uneven=LOG["uneven"],
    tail=Kind(
        NOTE,
        "Ordinates from {lowest:.6g} Hz, {lost} of {ordinates}, do not fill a group and are left out.",
        "Average them too with {option.keep_tail:True}.",
    ),
    gaps=Kind(
        CAUTION,
        "{missing} missing samples (NaN); a spectrum needs a record without gaps.",
        "Take the longest stretch without any, y[{first}:{last}]; of a log, log.select({start:.10g}, {stop:.10g}).",
        terminal="Take the longest stretch without any: {option.start:{start:.10g}} {option.stop:{stop:.10g}}.",
    ),
    scattered=Kind(
        CAUTION, "{missing} missing samples (NaN); the longest stretch without any has {longest}, and a spectrum needs at least {least}."
    ),
    constant=Kind(
        CAUTION,
        "Constant (every sample equal), which has no spectrum.",
        "Check that the sensor was running and that its resolution is finer than its noise; leave a dead channel out.",
    ),
    empty=Kind(CAUTION, "Nothing but NaN, which has no spectrum; leave it out."),
)
