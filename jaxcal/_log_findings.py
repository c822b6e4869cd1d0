"""Everything that a log says about its stamps and values: a table of findings, `LOG`."""

from ._answer import CAUTION, NOTE, Kind, table

LOG = table(
    # the stamps
    no_stamp=Kind(CAUTION, "{count} samples have no time stamp and are left out."),
    wraps=Kind(NOTE, "The time counter wraps {count} times, by 2^{bits} ticks of {tick:g} s; it is unwrapped."),
    unsorted=Kind(CAUTION, "{count} time stamps are out of order (largest step back {back:.6g} s); the samples are sorted by time."),
    recordings=Kind(CAUTION, "The stamps are those of {count} recordings in one file; only the longest is read, rows {rows} of {total}.",
                    "Read the others from files of their own."),
    copies=Kind(NOTE, "{count} samples repeat the stamp and the values of the one before; one of each is kept."),
    same_stamp=Kind(CAUTION, "{count} samples share the stamp of the one before, but not its values; they are spaced evenly."),
    coarse_stamps=Kind(CAUTION, "The time stamps resolve only {resolution:.3g} s{single}; the samples are spaced evenly at {rate:.6g} Hz."),
    bursts=Kind(CAUTION, "The time stamps come in bursts; the samples are spaced evenly at {rate:.6g} Hz."),
    jitter=Kind(NOTE, "The time stamps jitter by {percent:.2g} % of a step (rms){single}; the samples are spaced evenly at {rate:.6g} Hz.",
                limits=(1e-4, 0.02)),
    rate_given=Kind(NOTE, "The rate is {rate:g} Hz as given; the stamps say {estimate:.6g} Hz."),
    crowded=Kind(NOTE, "{count} of {total} readings have no sample of the log to themselves and are left out."),
    # the values
    wrapped=Kind(NOTE, "The values overflow {count} times, by {size:.6g}, as those of a counter; they are joined again."),
    infinite=Kind(CAUTION, "{count} infinite values are treated as missing."),
    constant=Kind(CAUTION, "Constant in every sample ({values} {unit}), so nothing can be said about its noise."),
    repeats=Kind(NOTE, "{percent:.2g} % of the samples repeat the one before in all axes and do not count: the sensor gives about "
                 "{rate:.3g} values a second, or packets were repeated."),
    resampled=Kind(NOTE, "The readings were interpolated, from about {size:.3g} Hz: their noise at short times is not that of the sensor.",
                   "Log the readings as they come.", limits=(300.0,)),
    frozen=Kind(CAUTION, "Frozen in {count} runs of {run} repeats or more, the longest {length:.3g} s at {at:.6g} s; these "
                "{samples} samples are missing."),
    zeroed=Kind(CAUTION, "{count} samples are exactly zero and do not count: a dead band of the firmware, or lost readings."),
    clipped=Kind(CAUTION, "Clipped: {count} samples stand at the extreme value {size:.6g}."),
    steps=Kind(NOTE, "The values come in steps of {step:.4g}."),
    warm_up=Kind(NOTE, "The mean of the first {length:g} s is off the rest by {size:.3g} (warm-up?).",
                 "log.select({length:g}, None) leaves them out.", terminal="{option.start:{length:g}} leaves them out."),
    set_aside=Kind(NOTE, "{seconds:.3g} s ({percent:.2g} %) are set aside: {what}.",
                   "{option.keep} keeps them.", terminal="{option.keep:all} keeps them.",
                   # real logs at rest have 1.5 % at most. Of simulated ones that are moved, N holds in 19 of 20 below and 10 of 10 above
                   limits=(0.0, 0.2)),
    # about results from the log, if the intervals of the best known values are more than twice as wide for it
    uneven=Kind(CAUTION, "The noise is uneven in time, largest between {start:.6g} and {stop:.6g} s; intervals are up to {factor:.2g} "
                "times as wide for it.", "Look there for a knock or a draught.", limits=(2.0,)),
    sparse=Kind(NOTE, "Present in {percent:.3g} % of the samples (about {rate:.3g} Hz)."),
    gaps=Kind(NOTE, "{count} of {total} samples are missing, in {gaps} gaps, the longest {longest:.4g} s at {at:.6g} s."),
)  # fmt: skip
