"""Parse the name of a column: quantity, axis and unit, in the spellings of common loggers.

A name is cut into words. The parser removes the word of the axis, then a unit at the end, then words for the origin of a column, and
looks up the rest. Quantities that jaxcal does not read (an attitude, acceleration without gravity) have their own kinds, so that they
are never mistaken for a sensor.
"""

import dataclasses
import difflib
import functools
import re
import unicodedata
from collections.abc import Iterator, Sequence

from .._units import find_unit

AXES = "xyz"
#: longest name that is parsed
LONGEST = 120
#: kinds that are not read as a sensor; "linear" is acceleration without gravity
OTHERS = ("linear", "gravity", "attitude", "motion", "counter", "d gyro", "d accel")


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_WORDS = {
    "gyro": (
        "g|gy|gyr|gyro|gyros|gyroscope|gyroscopes|gyroskop|giroscopio|giroscopo|gyrorotation|gyrorotationrate|gyroscoperotationrate|"
        "w|omega|om|"
        "angular|angularvelocity|angvelocity|angvel|angularvel|angularrate|angrate|anglerate|angularspeed|rate|rates|rotationrate|rotrate|"
        "rotationspeed|turnrate|rateofturn|drehrate|drehgeschwindigkeit|winkelgeschwindigkeit|vitesseangulaire|velocidadangular|"
        "hoeksnelheid|jiroskop|zyroskop|gyroskooppi|kulmanopeus|predkosckatowa|acsalhz|vinkelhastighet|"
        "uhlovarychlost|vinkelhastighed|vantocgoc|kutnabrzina|szogsebesseg|kecepatansudut|vitezaunghiulara|velocitaangolare|"
        "velocidadeangular|wrss|av|as|wb|gyrounfiltered|deltarate|pqr|rot|gyrorot|gyroscoperot|angvels|wibb|omegaibb"
    ),
    "accel": (
        "a|ac|acc|acce|accl|accel|accelero|accelerometer|accelerometers|acceleration|accelerations|accelerometeracceleration|f|gf|"
        "gforce|fb|"
        "specificforce|sf|totalacceleration|totalacc|accelerationincludinggravity|accelerationwithg|beschleunigung|beschl|"
        "beschleunigungssensor|beschleunigungmitg|versnelling|ivme|przyspieszenie|kiihtyvyys|zrychleni|gyorsulas|giatoc|ubrzanje|"
        "percepatan|acceleratie|aceleracion|acelerometro|accelerazione|accelerometro|aceleracao|acelerometro|arss|"
        "properacceleration|fibb"
    ),
    # this name means opposite things in ROS and phyphox; the values decide whether gravity is included
    "accel or linear": "linearacceleration|linearaccelerations|linearaccel|linearacc|linacc|linaccel|la|lia|linearebeschleunigung",
    "linear": (
        "useracceleration|useracc|motionuseracceleration|motionuseracc|freeacc|freeacceleration|accelerationwithoutg|"
        "accelerationwithoutgravity|worldacceleration|worldacc|earthacceleration|beschleunigungohneg|accelerationlineaire|"
        "aceleracionlineal|aaworld|aareal|dynamicacceleration"
    ),
    "gravity": "gravity|grav|gravityvector|motiongravity|schwerkraft|gravite|gravedad",
    "mag": (
        "m|mag|magn|cmp|magnet|magneto|magnetometer|magnetometers|magneticfield|magneticfields|magneticfieldstrength|magfield|compass|b|"
        "bfield|field|h|hm|mb|magnetfeld|magnetischesfeld|campomagnetico|champmagnetique|magnetometro|motionmagneticfield|motionmagnetic|"
        "geomagneticfield|magneticflux|magnetic"
    ),
    "attitude": (
        "roll|pitch|yaw|angle|angles|euler|eulerangles|quat|quaternion|q|orientation|rotationvector|gamerotationvector|attitude|rpy|"
        "heading|azimuth|mat|dcm|tilt|winkel|orientierung|ori"
    ),
    # increments over a sampling period
    "d gyro": "dtheta|dangle|deltaangle|deltatheta|dang|dphi",
    "d accel": "dv|dvel|deltavelocity|deltav|deltavel|dvelocity",
    "motion": "pos|position|p|vel|velocity|speed|v|lat|lon|latitude|longitude|alt|altitude|height|dist|displacement|trans|translation|d|s|"
        "vg",
}  # fmt: skip
_KINDS = {kind: frozenset(words.split("|")) for kind, words in _WORDS.items()}
#: words of which one with a wrong letter is no other word, and lengths of such
_LONG, _SPELLED = [word for kind in ("gyro", "accel", "mag") for word in _KINDS[kind] if len(word) > 8], range(8, 30)
_MEASURED = ("gyro", "accel", "mag", "temperature")
_TIME = _words(
    "t time timestamp timestamps stamp ts tstamp clock elapsed elapsedtime timeelapsed datetime utc utctime zeit zeitstempel uhrzeit "
    "temps tiempo tempo horodatage tijd zaman czas aika tid cas offsettime gpst secondselapsed elapsedseconds timesincestart timesinceboot "
    "timefromstart systemtime systime sensortime devicetime unixtime unixtimestamp unix epoch epoc epochtime timeintervalsince "
    "timestampsince loggingtime gpstow tow gpstime rostime hosttime phonetime phonetimestamp localtime rtc chiptime recordtime "
    "recordingtime logtime boottime timestampunix timeunix samplingtime timestampsample acquisitiontime runtime uptime relativetime "
    "reltime abstime absolutetime measurementtime timeboot timesincereset timetag gpssow sow timeofday timeofweek monotonictime "
    "waktu timp ido thoigian vrijeme "
    "starttime timestart timesample wallclock sensortimestamp loggingtimestamp motiontimestamp imutime imutimestamp timeimu"
)
#: words for units of time -> the unit
TIME_UNITS = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "sekunden": "s", "ms": "ms", "msec": "ms", "msecs": "ms",
    "millis": "ms", "millisec": "ms", "milliseconds": "ms", "millisecond": "ms", "us": "us", "usec": "us", "usecs": "us", "micros": "us",
    "microsec": "us", "microseconds": "us", "microsecond": "us", "ns": "ns", "nsec": "ns", "nsecs": "ns", "nanosec": "ns", "nanos": "ns",
    "nano": "ns", "nanoseconds": "ns", "min": "min", "minutes": "min",
}  # fmt: skip
_FRACTIONS = ("nsec", "nsecs", "nanosec")
_TEMPERATURE = _words("temp temperature imutemp imutemperature temperatur gyrotemp acctemp dietemp temperatura tmp")
_COUNTER = re.compile(
    r"|index|idx|unnamed|i|n|id|no|nr|num|number|row|rows|rownumber|line|seq|sequence|frame|frames|framenumber|frameid|counter|count|cnt|"
    r"packet|packets|packetcounter|packetnumber|packetnum|packetid|packetcount|sample|samples|samplenumber|sampleno|sampleid|sampleidx|"
    r"sampleindex|samplecount|samplecounter|nsamples|nsample|loopiteration|iteration|iter|record|recordnumber|point|punkt|zeile|step|"
    r"datapoint|msgcount|tickno|loggingsample|measurement|messung|tick|ticks|zahler|nummer|lfd|lfdnr|headerseq|serial|entry|event"
)
#: words for the origin of a column, not its quantity
_ORIGINS = _words(
    "imu field header msg data sensor sensors raw cal uncal calib uncalib calibrated uncalibrated value values val axis axe achse "
    "asse adc body attr corrected compensated smooth in of the device phone input reading readings meas measured signal comp "
    "component channel ch ahrs ins ln wr low noise wide range v mpu icm lsm bmi bno xsens mems filt filtered lpf avg"
)


#: words that change the meaning of a sensor's name
CHANGING = _words(
    "bias biases offset off std stdev stddev var variance cov covariance sigma rms error err true truth ref reference gt groundtruth est "
    "estimate estimated mean median max min peak target desired cmd command setpoint world earth nav global ned enu delta d dt integral "
    "integrated free linear lin user dynamic gravity grav jerk diff pos position vel velocity quat euler angle angles temp temperature "
    "scale factor misalignment drift residual innovation angular b bg ba setpoint sp"
)
#: stems of words in other scripts, in the order of the search
OTHER_SCRIPTS = {
    "\u03c9": "omega ", "\u03b5\u03c0\u03b9\u03c4\u03ac\u03c7": "acc", "\u03c7\u03c1\u03cc\u03bd": "time",
    "\u52a0\u901f": "acc", "\u89d2\u901f": "gyro", "\u9640\u87ba": "gyro", "\u30b8\u30e3\u30a4\u30ed": "gyro", "\u78c1": "mag",
    "\u65f6\u95f4": "time", "\u6642\u9593": "time", "\u6642\u523b": "time", "\u6e29\u5ea6": "temperature", "\u89d2\u5ea6": "angle",
    "\u56db\u5143\u6570": "quat", "\u901f\u5ea6": "velocity", "\u4f4d\u7f6e": "position", "\u8f74": "", "\u8ef8": "",
    "\uac00\uc18d": "acc", "\uac01\uc18d": "gyro", "\uc790\uc774\ub85c": "gyro", "\uc790\uae30": "mag", "\uc2dc\uac04": "time",
    "\uc628\ub3c4": "temperature", "\u0443\u0441\u043a\u043e\u0440": "acc", "\u043f\u0440\u0438\u0441\u043a": "acc",
    "\u0432\u0440\u0435\u043c": "time", "\u0443\u0433\u043b": "angular", "\u043a\u0443\u0442\u043e\u0432": "angular",
    "\u0441\u043a\u043e\u0440": "velocity", "\u0448\u0432\u0438\u0434\u043a": "velocity",
    "\u0442\u0435\u043c\u043f\u0435\u0440": "temperature",
}  # fmt: skip
#: letters of units in Russian
_RUSSIAN = str.maketrans("\u0433\u0440\u0430\u0434\u043c\u0441\u043a\u0442\u043d\u0422\u043b", "gradmsktnT ")
#: entries in the place of a unit for values without a unit
RELATIVE = re.compile(r"a\.?u\.?|arb(?:itrary)?\.?(?: units?)?|normali[sz]ed|local_flux|unitless|-", re.IGNORECASE)
COUNTS = re.compile(r"lsb|counts?|adc|digits?", re.IGNORECASE)


#: words for units -> the unit
_LONG_UNITS = {
    r"\*\*": "^", r"\u00ba": "\u00b0", r"\bmet(?:er|re)s?\b": "m", r"\bmilli[ -]?deg(?:ree)?s?\b": "mdeg",
    r"\bdegrees?\b": "deg", r"\bradians?\b": "rad", r"\bseconds?\b": "s", r" *\bsquared\b": "^2", r"^g['\u2019]s$": "g",
    r"(?:micro|\bu)[ -]?teslas?": "uT", r"nano[ -]?teslas?": "nT", r"(?<=tesla)s": "",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Name:
    """Meaning of a column name.

    `kind` is a quantity of a log or one of `OTHERS`, `axis` is x, y, z, "" or "nsec", `unit` is None if the name has no unit, and
    `stem` is the same for all columns of one sensor of a known device. `sure` is False if only some of the words say so.
    """

    kind: str
    axis: str = ""
    unit: str | None = None
    stem: str = ""
    sure: bool = True


def bracketed(name: str) -> str | None:
    """Text in the brackets of a column name, or None; a number in brackets is an axis and is ignored."""
    found = [text for pair in re.findall(r"\[([^\]]*)\]|\(((?:[^()]|\([^()]*\))*)\)", name) for text in map(str.strip, pair) if text]
    found.sort(key=lambda text: f"[{text}]" not in name)  # a unit stands in square brackets, if there are some
    return next((text for text in found if not text.isdigit() and text.lower() not in tuple(AXES)), None)


@functools.lru_cache(4096)
def unit_of(text: str, quantity: str) -> str | None:
    """Parse a unit in a header, with exponents such as ``rad s^-1`` and ``m s-2``; None if it is unknown."""
    text = text.replace("\u043c\u043a", "u").translate(_RUSSIAN)
    text = re.sub(r"\((\w+\^?\d?)\)", r"\1", re.sub("^(?i:in|units?:?) +", "", text.strip())).rstrip("* ")
    if quantity != "time":
        for pattern, plain in _LONG_UNITS.items():
            text = re.sub(pattern, plain, text, flags=re.IGNORECASE)
    if quantity == "mag" and text in ("g", "mg"):
        return {"g": "G", "mg": "mG"}[text]
    # superscripts and the degree sign, also after a wrong decoding
    text = text.replace("\u207b\u00b9", "-1").replace("\u207b\u00b2", "-2").replace("\u00b7", " ").replace("*", " ")
    text = re.sub(r"\u00b2|\u00e2\u00b2|\u00c2\u00b2", "2", text).replace("\u00c2", "")
    text = re.sub(r"^(?:\u00b0|degrees?|grad)(?=\s*(?:/|per|s))", "deg", re.sub(r"\s*\bper\b\s*", "/", text), flags=re.IGNORECASE)
    text = re.sub(r"[ _.]s(?:ec)?\^?\(?-([12])\)?$", lambda found: "/s^2" if found[1] == "2" else "/s", text)
    if quantity == "mag" and re.fullmatch(r"[^\x00-\x7f]t|micro[ _]?tesla", text, re.IGNORECASE):
        return "uT"
    if quantity == "temperature" and re.fullmatch(r"(?:deg\.? ?|[^\x00-\x7f]{0,2})C?", text) and text:
        return "degC"
    return find_unit(re.sub(r"\s*/\s*", "/", text), quantity)


def _cut(name: str) -> list[list[str]]:
    """Words of a name in lower case, in two ways: also cut at capital letters, and cut at separators only."""
    if not name.isascii():
        low = name.lower()
        for word, ours in OTHER_SCRIPTS.items():
            if word in low:
                name = low = low.replace(word, f" {ours} ")
    name = re.sub(r"[\[(]([xyzXYZ0-2])[\])]", r" \1 ", name)  # Accelerometer (x), acc[0]
    plain = unicodedata.normalize("NFKD", re.sub(r"\[[^\]]*\]|\([^)]*\)", " ", name)).encode("ascii", "ignore").decode()
    camel = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", plain)
    whole = re.findall(r"[0-9A-Za-z]+", plain)
    return [[word.lower() for word in words] for words in (camel, whole)]


def words_of(name: str) -> list[str]:
    """Words of a name in lower case, without brackets, also cut at capital letters."""
    return _cut(name[:LONGEST])[0]


def plain(name: str) -> str:
    """A name reduced to letters and digits, without brackets."""
    return "".join(_cut(name[:LONGEST])[1])


def is_counter(name: str) -> bool:
    """Whether a name denotes a row or packet counter, which is not a time; an empty name counts as a counter."""
    words = [word for word in _cut(name[:LONGEST])[0] if not word.isdigit() and word not in ("imu", "data")]
    if not words and any(letter.isalpha() and not letter.isascii() for letter in name):
        return False  # an unknown word in another script
    return bool(_COUNTER.fullmatch("".join(words)))


#: words of places, commands and surroundings, whose values may rise for a while
_RISES = _words(
    "lat latitude lon lng long longitude alt altitude elevation height depth range distance dist odometer odo declination inclination dip "
    "pressure baro temp temperature humidity battery voltage volt throttle rudder elevator aileron rc pwm motor servo  northing easting "
    "wheel encoder steering label class activity subject user trial"
)


_QUATERNION = _words("qw qx qy qz q0 q1 q2 q3 vx vy vz px py pz ve vn vu vd pn pe bgx bgy bgz bax bay baz")


def is_other(name: str) -> bool:
    """Whether a word of a name denotes an attitude, a motion, a place or so, which may rise for a while as time does."""
    words = {word for words in _cut(name[:LONGEST]) for word in words if len(word) > 1}
    found = parse(name)
    known = found is not None and found.kind in ("attitude", "motion", "gravity")
    return (
        known
        or bool(re.match("b_?[wag]_", name.lower()))
        or not words.isdisjoint(_KINDS["attitude"] | _KINDS["motion"] | _RISES | CHANGING | _QUATERNION)
    )


@functools.lru_cache(4096)
def parse(name: str) -> Name | None:
    """Meaning of a name, or None."""
    if len(name) > LONGEST:
        return None
    inside = bracketed(name)
    for words in _cut(name):
        if words and (found := _time(words, inside) or _temperature(words, inside)):
            return found
        for axis, rest in placed(words, AXES):
            found = described(rest)
            if found is not None and found.sure:
                if found.kind in ("d gyro", "d accel"):
                    break
                return Name(found.kind, axis, found.unit or unit_in(inside, found.kind))
    # for x, y, z with a unit, the unit determines the sensor
    bare = "".join(_cut(name)[0]).removesuffix("axis").removeprefix("axis")
    for kind in ("gyro", "accel", "mag") if bare in tuple(AXES) and inside else ():
        if unit := unit_of(inside or "", kind):
            return Name("accel or linear" if kind == "accel" else kind, bare, unit)
    return Name("counter") if is_counter(name) and name else None


def unit_in(inside: str | None, kind: str) -> str | None:
    """The unit of a kind in the brackets of a name, or None."""
    if not inside or kind in ("gravity", "attitude", "motion", "counter"):
        return None
    # gyro_rad and gyro [mDeg] mean rates, also of angles that are differenced
    angle = kind == "gyro" and re.fullmatch("m?(?:deg|rad)", inside, re.IGNORECASE)
    return unit_of(inside.lower() + "/s" if angle else inside, quantity_of(kind))


#: units of other quantities, which no sensor here has
_FOREIGN = re.compile(
    r"[munk]?(?:v|volts?|a|amps?|n|nm|pa|bar|ohm|w|hz|l|pct)|%|[kcm]?m|km/h|mph|kn|rpm|dbm?|lux|[\u00b5u]?s/cm|bpm|ppm", re.IGNORECASE
)


def foreign(unit: str | None) -> bool:
    """Whether a unit in a header is that of another quantity, such as V or hPa."""
    return bool(unit and _FOREIGN.fullmatch(unit))


def quantity_of(kind: str) -> str:
    """The sensor whose units a kind has."""
    return "accel" if kind in ("accel or linear", "linear", "gravity") else kind


def placed(words: list[str], axes: Sequence[str] = AXES) -> Iterator[tuple[str, list[str]]]:
    """Axes x, y, z that a name may mean, which it calls by the words `axes`, and the other words; the most literal first."""
    for i, word in enumerate(words):
        if word in axes:
            yield AXES[axes.index(word)], [*words[:i], *words[i + 1 :]]
    for i, word in enumerate(words if axes == AXES else ()):
        if match := re.fullmatch(r"(.*)([xyz])(\d|[a-z]?)", word):  # accx, accx1, x1, axl
            yield match[2], [*words[:i], *filter(None, (match[1], match[3])), *words[i + 1 :]]
        if match := re.fullmatch(
            "([xyz])(?![agm][xyz]$)(?:[bsv]|([agmw]|..+))", word
        ):  # xaccel, or xb in the frame of the body, the sensor or the vehicle; xa means something beside xg only
            yield match[1], [*words[:i], *(rest.rjust(2, "_") for rest in match.groups()[1:] if rest), *words[i + 1 :]]


def described(words: list[str]) -> Name | None:
    """What the words beside an axis say; None if they say nothing, or a word among them may change the meaning."""
    for tail in (0, *range(min(3, len(words) - 1), 0, -1)):  # try the longest unit first: mg before g
        head, end = words[: len(words) - tail], words[len(words) - tail :]
        if (kind := _kind(head)) is None:
            continue
        unit = _spelled(end, quantity_of(kind)) if quantity_of(kind) in ("gyro", "accel", "mag") else None
        if not end or unit or (kind in OTHERS and all(word in _ORIGINS or word.isdigit() for word in end)):
            return Name(kind, "", unit)
    for size in range(len(words) - 1, 0, -1):
        for start in range(len(words) - size + 1):
            dropped = [*words[:start], *words[start + size :]]
            kind = _kind(words[start : start + size])
            if kind not in (None, *OTHERS) and not any(word in CHANGING or kind_of(word) not in (None, kind) for word in dropped):
                return Name(kind, sure=False)
    if any(kind_of(word) in OTHERS for word in words) and not any(kind_of(word) in _MEASURED for word in words):
        return Name("motion", sure=False)
    right = [next(iter(difflib.get_close_matches(word, _LONG, 1, 0.9)), word) if len(word) in _SPELLED else word for word in words]
    return described(right) if right != words else None  # with long words as they are spelled


def kind_of(word: str) -> str | None:
    """The kind that a word denotes, or None."""
    return next((kind for kind, known in _KINDS.items() if word in known), None)


def _spelled(words: list[str], quantity: str) -> str | None:
    """Unit spelled by the words at the end of a name, or None."""
    words = [*words, "s"] if quantity == "gyro" and words in (["rad"], ["deg"]) else words
    return next((unit for glue in ("", "_", "/", " ") if (unit := unit_of(glue.join(words), quantity))), None)


def _kind(words: list[str]) -> str | None:
    """Kind of a sensor's name, or None."""
    bare = [word for one in words if (word := one.rstrip("0123456789"))]
    for candidate in ([word for word in bare if word not in _ORIGINS] or bare, bare):
        joined = "".join(candidate)
        # field_x_G is a field in gauss, not a gyroscope in the field of a message
        if (kind := kind_of(joined)) and not (joined in ("g", "m") and "field" in bare):
            return kind
    return None


def _time(words: list[str], inside: str | None) -> Name | None:
    bare = [word for word in words if word not in _ORIGINS and not word.isdigit()]
    if not bare:
        return None
    joined, head, last = "".join(bare), "".join(bare[:-1]), bare[-1]
    own = unit_of(inside, "time") or TIME_UNITS.get(inside.lower()) if inside else None
    # a unit in brackets outranks the name: Ts [deg.C] is a temperature, t [V] something else
    if inside and own is None and (joined in ("t", "ts") or any(unit_of(inside, quantity) for quantity in _MEASURED)):
        return None
    if joined == "sampletimefine":
        return Name("time", "", "sampletimefine")
    if joined in _TIME:
        return Name("time", "", own or ("s" if "seconds" in joined or joined in ("gpstow", "tow", "gpssow", "sow") else None))
    # a column that is called "s" is not a time, and utc_second a part of a date
    if last in TIME_UNITS and ((head in _TIME and (own or head != "utc")) or (not head and last not in ("s", "min", "nano", "second"))):
        return Name("time", "nsec" if last in _FRACTIONS else "", TIME_UNITS[last])
    # "elapsed seconds", "milliseconds since start", "timestampms"
    if bare[0] in TIME_UNITS and "".join(bare[1:]) in ("elapsed", "sincestart", "sinceboot", "fromstart", "start"):
        return Name("time", "", TIME_UNITS[bare[0]])
    match = re.fullmatch(r"(?:time|timestamp|timestampsample|t|ts|stamp)(usec|msec|nsec|us|ms|ns|sec|s)", joined)
    return Name("time", "", TIME_UNITS[match[1]]) if match and joined not in ("ts",) else None


def _temperature(words: list[str], inside: str | None) -> Name | None:
    bare = [word for word in words if word not in _ORIGINS and not word.isdigit()] or words
    joined = "".join(bare)
    own = unit_of(inside, "temperature") if inside else None
    if joined in _TEMPERATURE or (own and re.fullmatch("t[a-z]?", joined)):
        return Name("temperature", "", own)
    unit = unit_of(bare[-1], "temperature") if len(bare) > 1 else None
    if unit and ("".join(bare[:-1]) in _TEMPERATURE or bare[:-1] == ["t"]):
        return Name("temperature", "", unit)
    return Name("temperature", "", "degC") if joined == "tempc" else None


def parse_name(name: str) -> tuple[str, str, str | None] | None:
    """Quantity, axis (x, y, z, or ""; "nsec" for the nanoseconds of a time stamp) and unit of a column name.

    Examples
    --------
    >>> from jaxcal.io._names import parse_name
    >>> parse_name("gyro_x_dps"), parse_name("a_RS_S_z [m s^-2]"), parse_name("TimeUS"), parse_name("Notes")
    (('gyro', 'x', 'deg/s'), ('accel', 'z', 'm/s^2'), ('time', '', 'us'), None)
    """
    found = parse(name)
    if found is None or found.kind in OTHERS:
        return None
    unit = "1e-4 s" if found.unit == "sampletimefine" else found.unit
    return "accel" if found.kind == "accel or linear" else found.kind, found.axis, unit
