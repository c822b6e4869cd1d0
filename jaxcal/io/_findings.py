"""Everything that a reader says about a log: a table of findings, `READ`.

A finding that is certain is a note. One that was inferred, and changes the numbers if it is wrong, is a guess: it stands above all results.
"""

from .._answer import CAUTION, NOTE, Kind, table

_OVERRIDE = "If the unit is wrong: {option.units:{quantity}={other}}."
READ = table(
    # which column is what, and in which unit
    stated=Kind(NOTE, "{where}, {unit}{why}."),
    read_as=Kind(NOTE, "{where}, {unit}{why}.", _OVERRIDE),
    assumed=Kind(CAUTION, "A guess: {where}, {unit}{why}.", _OVERRIDE, guess=True),
    roles=Kind(CAUTION, "A guess from the size of the values, since no name says so: {which}.",
               "If that is wrong, say which is which, as in {option.columns:{given}}.", guess=True),
    rate_stated=Kind(NOTE, "The rate is {rate:g} Hz, as {source}.", "If that is wrong: {option.rate:HZ}."),
    rate_of_name=Kind(CAUTION, "A guess: the rate is {rate:g} Hz, as the file's name says; there is no time column.",
                      "If that is wrong: {option.rate:HZ}.", guess=True),
    oscillator=Kind(CAUTION, "A guess: {clock} holds fractional frequencies.", "If they are phases: {option.data:phase}.", guess=True),
    nominal=Kind(CAUTION, "A guess: {clock} is in Hz, of an oscillator of {nominal:.10g} Hz.", "If that is wrong: {option.nominal:HZ}.",
                 guess=True),
    slow_clock=Kind(CAUTION, "A guess: {clock} in {unit} gives one sample every {step:.4g} s.",
                    "If that is wrong: {option.units:time=...}.", guess=True),
    device=Kind(NOTE, "The columns are those of {name}{sign}."),
    counts_rows=Kind(NOTE, "{columns} counts rows and is no time."),
    newest_first=Kind(CAUTION, "The rows stand newest first by {clock}; they are read in the order of time."),
    not_read=Kind(NOTE, "Not read: {what}."),
    topics=Kind(NOTE, "{chosen} is read, and not {others}.", "Read others with {option.topics}."),
    joined=Kind(NOTE, "The recording is {count} files: {which}."),
    own_stamps=Kind(NOTE, "{source} has stamps of its own; the readings stand at the nearest stamps of {main}.",
                    "For its noise, read it alone: {option.topics:{source}}."),
    temperature=Kind(NOTE, "The temperature is that of {source}, at the stamps of {main}."),
    increments=Kind(CAUTION, "{quantity}: increments over a sampling period, by their names; they are divided by it.",
                    "If they are none: {option.columns:{quantity}=...}.", guess=True),
    no_clock=Kind(CAUTION, "There is no clock: the readings are taken one by one, at 1 Hz, so that no time and no rate means anything.",
                  "If they have a rate: {option.rate:HZ}."),
    phase=Kind(NOTE, "The values are taken as time integrals; their differences over the sampling period are used ({option.data:phase})."),
    # what is doubtful
    left_out=Kind(CAUTION, "Left out: {why}.", "To read it all the same: {option.units:{quantity}=...}."),
    gravity_free=Kind(CAUTION, "{columns} is acceleration without gravity, which is no specific force, and is not read."),
    against_values=Kind(CAUTION, "Read in {unit} ({where}), although {why}."),
    against_header=Kind(CAUTION, "Read in {unit} as given, although its columns state {header}."),
    turns_differ=Kind(CAUTION, "Gravity or the field turns {ratio:.3g} times as fast as the gyroscope says (r = {r:.2f}): {what}."),
    turns_against=Kind(CAUTION, "The gyroscope turns against gravity or the field: axes or a sign differ, and what uses both is wrong.",
                       "Put the columns in order, with their sign, as in {option.units:gyro=-1 deg/s}."),
    clocks_differ=Kind(CAUTION, "{chosen} is read as time; {other} disagrees by {percent:.2g} % in rate.",
                       "To compare: {option.columns:time={column}}."),
    rate_differs=Kind(CAUTION, "{source} {stated:g} Hz, but the stamps say {rate:.5g} Hz, which is used."),
    several_columns=Kind(CAUTION, "{names} is read, and not {others}.", "To read another: {option.columns:{quantity}={first}}."),
    several_sensors=Kind(CAUTION, "{chosen} is read, the first of {count} sensors of its kind.",
                         "Read others with {option.topics}: {others}."),
    file_not_read=Kind(CAUTION, "{file} is not read: {why}."),
    mixed=Kind(CAUTION, "{why}."),
    strange=Kind(CAUTION, "Not read, although the names or values look like those of a sensor: {columns}.",
                 "To read them: {option.columns:{first}}."),
    skips=Kind(CAUTION, "{counter} counts the samples and skips {count} of them in {places} places: these are missing."),
    # what is damaged
    rows_left_out=Kind(CAUTION, "{count} of {rows} rows do not have {width} fields and are left out; the first is line {line}: {shown!r}."),
    text_missing=Kind(CAUTION, "{column} holds text in {count} of {rows} rows, which is missing; the first is {shown!r} in line {line}."),
    last_row=Kind(CAUTION, "The file does not end with a line feed: its last row may be cut off within a number, and is left out."),
    holes=Kind(CAUTION, "Blocks of zero bytes, where the logger did not write, are left out; a row beside one may be lost."),
    damaged=Kind(CAUTION, "The file is damaged or cut off: {what}."),
    dropped=Kind(CAUTION, "The logger dropped {what}; samples lost there are gaps."),
    reception=Kind(CAUTION, "The header stamps are all the same; the times of reception are used, which jitter more."),
    # what was done to the readings before they were logged
    applied=Kind(CAUTION, "Already corrected by {who}: a calibration found from it comes on top."),
    filtered=Kind(CAUTION, "{what}: noise found from it is too small.", "Record {better}."),
    batches=Kind(NOTE, "{count} batches at {rate:.6g} Hz, raw, with gaps between them; {cut} are not complete."),
    unstated=Kind(CAUTION, "The log does not say whether these readings are calibrated or filtered."),
    logging_times=Kind(NOTE, "There are no stamps of the samples (timestamp_sample); the times of logging are used."),
    several_devices=Kind(CAUTION, "The readings come from more than one device ({devices})."),
    recalibrated=Kind(CAUTION, "The calibration changed {count} times while the log ran; {read} of {total} rows are read."),
    sensor_clipped=Kind(CAUTION, "The sensor clipped in {count} rows (clip_counter)."),
)  # fmt: skip
