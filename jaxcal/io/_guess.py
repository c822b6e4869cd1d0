"""Units, and the roles of columns without names, told from the values."""

import dataclasses

import numpy as np

from .._errors import DataError

#: samples looked at where a few suffice
_LOOK = 50_000
#: sensor -> size of the Earth's gravity, or of a field of 1 uT, in each unit, and the unit to name where the guess is wrong
_SIZES = {
    "accel": {"m/s^2": (9.80665, "g"), "g": (1.0, "m/s^2"), "mg": (1000.0, "g")},
    "mag": {"T": (1e-6, "uT"), "G": (1e-2, "uT"), "uT": (1.0, "G"), "mG": (10.0, "uT"), "nT": (1e3, "uT")},
}
#: sensor -> least and largest size of what is certain, then of what is uncertain, with the units in which whole numbers are no counts
_RANGES = {
    "accel": ((0.88, 1.12, "", ("m/s^2", "g", "mg")), (0.7, 1.4, "; uncertain", ("mg",))),
    "mag": ((22, 67, "", ("T", "G", "nT")), (15, 100, "; uncertain", ())),
}
#: Modified Julian Dates from 1968 to 2132, and the step (in d, 4 s) above which they may as well be seconds
_MJD, _MJD_STEP = (40_000.0, 100_000.0), 5e-5
#: time unit -> (first epoch start, last), and the upper end of its range of median steps
_EPOCH = {"s": (1e9, 4e9), "ms": (1e12, 4e12), "us": (1e15, 4e15), "ns": (1e18, 4e18)}
_TABLE = {
    True: (("ms", 100.0), ("us", 1e5), ("ns", np.inf)),
    False: (("s", 0.5), ("ms", 100.0), ("us", 1e5), ("ns", np.inf)),
}
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_DAY = 86400.0


@dataclasses.dataclass(frozen=True)
class Guess:
    """A unit, why, and the unit to name where the guess is wrong."""

    unit: str
    reason: str
    other: str


def time_unit(stamps: np.ndarray, integer: bool, rate: float | int | None) -> Guess:
    """Unit of the stamps: that which agrees with `rate`, that of an epoch, or by the median step."""
    steps = np.diff(stamps)
    steps = steps[(steps > 0) & np.isfinite(steps)]
    if not len(steps):
        raise DataError("the time column never rises; name another one with columns={'time': ...} (--columns time=...), or give rate=")
    step = float(np.median(steps))
    kind = "integer" if integer else "decimal"
    seen = f"median step {step:.3g}, {kind}"
    start = float(stamps[np.isfinite(stamps)][0])
    if not integer and _MJD[0] <= start <= _MJD[1]:
        agrees = rate is not None and abs(1 / (step * _DAY) / rate - 1) < 0.05
        # as seconds it would be a rate beyond 20 kHz
        if agrees or (rate is None and step < _MJD_STEP):
            return Guess("mjd", f"{seen}, from {start:.6g} on: Modified Julian Dates", "s")
    if rate is not None:
        mean = (len(stamps) - 1) / float(np.nanmax(stamps) - np.nanmin(stamps))
        for unit, seconds in _SECONDS.items():
            if min(abs(1 / (step * seconds) / rate - 1), abs(mean / seconds / rate - 1)) < 0.05:
                return Guess(unit, f"{seen}: agrees with rate={rate:g}", "ms" if unit == "s" else "s")
    for unit, (first, last) in _EPOCH.items():
        # a rate far outside any sensor's means that a time since boot only looks like an epoch
        if first <= start <= last and 0.1 < 1 / (step * _SECONDS[unit]) < 1e6:
            return Guess(unit, f"starts at {start:.4g}, as time since 1970 does", "ms" if unit == "s" else "s")
    table = _TABLE[integer]
    at = next(i for i, (_, upper) in enumerate(table) if step < upper)
    unit = table[at][0]
    lower = table[at - 1][1] if at else (1.0 if integer else 0.0)
    if at + 1 < len(table) and step > table[at][1] / 3:
        return Guess(unit, f"{seen}; uncertain, could be {table[at + 1][0]}", table[at + 1][0])
    if lower and step < 3 * lower:
        other = table[at - 1][0] if at else "s"
        return Guess(unit, f"{seen}; uncertain, could be {other}", other)
    return Guess(unit, seen, table[at + 1][0] if at + 1 < len(table) else table[at - 1][0])


def accel_unit(values: np.ndarray) -> Guess:
    """Unit of an accelerometer from the median norm, which is that of gravity."""
    norm = median_norm(values)
    return _by_size("accel", norm, f"median norm {norm:.4g}", values)


def mag_unit(values: np.ndarray) -> Guess:
    """Unit of a magnetometer from the radius of a first sphere fit: the Earth's field is 22 to 67 uT."""
    radius, how = _field(values)
    return _by_size("mag", radius, f"{how} {radius:.3g}", values)


def _by_size(sensor: str, size: float, seen: str, values: np.ndarray) -> Guess:
    whole = all_integer(values)
    for unit, (one, other) in _SIZES[sensor].items():
        for low, high, doubt, no_counts in _RANGES[sensor]:
            if low <= size / one <= high and (not whole or unit in no_counts):
                return Guess(unit, seen + doubt, other)
    raise DataError(_undecided(sensor, seen, values, {"accel": "g", "mag": "uT"}[sensor]))


def gyro_unit(values: np.ndarray, accel: np.ndarray | None, rate: float | int | None) -> Guess:
    """Unit of a gyroscope: by size, by the turns that the accelerometer (n, 3), in any unit, sees, or assumed."""
    if all_integer(values):
        raise DataError(_undecided("gyro", "all values are whole numbers", values, "deg/s"))
    largest = float(np.nanmax(np.abs(values)))
    if largest > 35:
        return Guess("deg/s", f"reaches {largest:.3g}; 35 rad/s would be 2005 deg/s", "rad/s")
    if accel is not None and rate and np.isfinite(rate) and accel.shape[1] == values.shape[1] == 3:
        ratio = _turn_ratio(values, accel, rate)
        if ratio is not None:
            # a turn is at least as long as the angle between its ends, and seldom many times longer
            uncertain = "; uncertain" if 8 < ratio < 40 else ""
            reason = f"integrates to {ratio:.2g} times the turns of gravity{uncertain}"
            return Guess("deg/s", reason, "rad/s") if ratio > 20 else Guess("rad/s", reason, "deg/s")
    # of some 100 stretches
    norms = _norms(values)
    block = max(1, len(norms) // 100)
    norms = np.median(norms[: len(norms) // block * block].reshape(-1, block), axis=1)
    quiet, lively = np.quantile(norms, [0.1, 0.9])
    if lively > 3 * quiet:
        return Guess("rad/s", f"assumed: the sensor moves, yet reaches only {largest:.3g}", "deg/s")
    norm = float(np.median(norms))
    if norm > 0.35:
        return Guess("deg/s", f"median norm {norm:.3g} at rest, too much for rad/s", "rad/s")
    return Guess("rad/s", f"assumed: median norm {norm:.3g} at rest fits rad/s and deg/s", "deg/s")


def temperature_unit(values: np.ndarray) -> Guess:
    """K above 200, else degC."""
    median = float(np.nanmedian(values))
    return Guess("K", f"median {median:.4g}", "degC") if median > 200 else Guess("degC", f"median {median:.4g}", "K")


def roles(triples: list[np.ndarray]) -> list[str]:
    """Which sensor each of one, two or three triples of nameless columns is.

    Gravity and the magnetic field keep their norm when the sensor turns; an angular rate does not.
    """
    if len(triples) == 1:
        if all_integer(triples[0]) and not (_gravity_like(triples[0]) or _field_like(triples[0])):
            raise DataError("three columns of whole numbers, which look like raw counts, do not say of which sensor")
        return ["accel" if _gravity_like(triples[0]) else "mag" if _field_like(triples[0]) else "gyro"]
    likeness = [_gravity_like(triple) for triple in triples[:2]]
    if not any(likeness):
        raise DataError("neither triple of columns has the norm of gravity in m/s^2, g or mg")
    if all(likeness):
        likeness = [_spread(triples[0]) < _spread(triples[1])] * 2
        likeness[1] = not likeness[0]
    pair = ["accel", "gyro"] if likeness[0] else ["gyro", "accel"]
    return pair + ["mag"] * (len(triples) - 2)


def _gravity_like(values: np.ndarray) -> bool:
    return any(0.7 <= median_norm(values) / one <= 1.4 for one, _ in _SIZES["accel"].values()) and _spread(values) < 0.5


def _field_like(values: np.ndarray) -> bool:
    radius, _ = _field(values)
    return any(22 <= radius / one <= 67 for one, _ in _SIZES["mag"].values()) and _spread(values) < 0.9


def _thinned(values: np.ndarray) -> np.ndarray:
    values = values[:: max(1, len(values) // _LOOK)]
    return values[np.isfinite(values).all(axis=1)]


def _norms(values: np.ndarray) -> np.ndarray:
    return np.linalg.norm(_thinned(values), axis=1)


def _spread(values: np.ndarray) -> float:
    norms = _norms(values)
    return float(np.std(norms) / np.median(norms)) if len(norms) else np.inf


def median_norm(values: np.ndarray) -> float:
    """Median length of the vectors."""
    norms = _norms(values)
    return float(np.median(norms)) if len(norms) else np.nan


def all_integer(values: np.ndarray) -> bool:
    """Whether all values are whole numbers, and not merely zeros and ones."""
    seen = _thinned(values)
    return bool(len(seen) and np.all(seen == np.round(seen)) and np.ptp(seen) >= 5)


def _field(values: np.ndarray) -> tuple[float, str]:
    """Radius of the sphere through the vectors, or their median norm where they cover too little of one."""
    seen = _thinned(values)
    if len(seen) > 5000:
        seen = seen[:: len(seen) // 5000]
    if values.shape[1] == 3 and len(seen) > 10:
        centred = seen - seen.mean(axis=0)
        size = np.sqrt(np.mean(np.sum(centred**2, axis=1)))
        if 0 < size < np.inf and np.linalg.svd(centred / size, compute_uv=False)[-1] > 0.1 * np.sqrt(len(seen)):
            # |v|^2 = 2 c.v + r^2 - |c|^2, linear in c and the constant
            unknowns, *_ = np.linalg.lstsq(
                np.column_stack([2 * centred / size, np.ones(len(seen))]), np.sum((centred / size) ** 2, axis=1), rcond=None
            )
            radius = np.sqrt(max(0.0, unknowns[3] + unknowns[:3] @ unknowns[:3]))
            # a cloud of noise fills the sphere instead of lying on it
            if np.std(np.linalg.norm(centred / size - unknowns[:3], axis=1)) < 0.25 * radius:
                return float(size * radius), "sphere radius"
    return median_norm(values), "median norm"


def _turn_ratio(gyro: np.ndarray, accel: np.ndarray, rate: float) -> float | None:
    """Least ratio of the integrated angle to the angle between the gravity directions of successive still stretches."""
    block = max(2, round(0.5 * rate))
    count = len(gyro) // block
    if count < 4:
        return None
    shape = (count, block, 3)
    force, turn = accel[: count * block].reshape(shape), gyro[: count * block].reshape(shape)
    whole = np.isfinite(force).all(axis=(1, 2)) & np.isfinite(turn).all(axis=(1, 2))
    if not whole.any():
        return None
    mean = force.mean(axis=1)
    scatter = np.linalg.norm(force.std(axis=1), axis=1) / np.median(np.linalg.norm(mean[whole], axis=1))
    still = whole & (scatter < max(5 * np.quantile(scatter[whole], 0.1), 1e-4))
    if still.all() or not still.any():
        return None
    bias = np.median(turn[still].reshape(-1, 3), axis=0)
    path = np.cumsum(np.nansum(np.linalg.norm(turn - bias[None, None, :], axis=2), axis=1)) / rate
    down = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    at = np.flatnonzero(still)
    before, after = at[:-1], at[1:]
    angle = np.arccos(np.clip(np.sum(down[before] * down[after], axis=1), -1.0, 1.0))
    turned = (after > before + 1) & (angle > np.radians(20))
    return float(np.min((path[after] - path[before])[turned] / angle[turned])) if turned.any() else None


def _undecided(sensor: str, seen: str, values: np.ndarray, example: str) -> str:
    if all_integer(values):
        return (
            f"the unit of {sensor} cannot be told ({seen}): these look like raw counts; give the size of one, as in "
            f"units={{'{sensor}': '0.01 {example}'}} (--units {sensor}='0.01 {example}')"
        )
    return f"the unit of {sensor} cannot be told ({seen}); give it with units={{'{sensor}': '{example}'}} (--units {sensor}={example})"
