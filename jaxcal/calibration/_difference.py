"""`difference`: the changes between two calibrations of one device, and whether they exceed their uncertainty."""

import dataclasses
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Grid, Number, Result, Section
from .._errors import DataError
from .._precision import host_float64
from .._special import NORMAL95
from .._types import AnyArray
from ..magnetometer._model import HARD, SOFT
from ._calibration import Calibration
from ._findings import FINDINGS
from ._parts import Part, quantities_of
from ._thermal import Thermal

_RANK = 1e-9  # smallest eigenvalue of the correlations that counts, relative to the largest
_AXES = "xyz"
#: entries of the symmetric matrix of an ellipsoid in the order of the covariance
_QUADRIC = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


class PartDifference(eqx.Module):
    """Changes in one part of a calibration, such as the accelerometer.

    Attributes
    ----------
    name : "accel", "gyro", "magnetometer", "noise gyro_x" or "temperature gyro".
    parameters, quantities : name of each row, and name of its quantity in the table of units.
    first, second : (p,) values of the two calibrations.
    standard_error : (p,) standard error of second - first; NaN if neither covariance is known, 0 for parameters fixed by a convention.
    chi_square, degrees_of_freedom : for all differences together under both covariances; NaN and 0 without covariances.
    probability : probability of a chi-square at least as large if nothing changed.
    findings : what to know about this part.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> def device(bias):
    ...     return jaxcal.Calibration(magnetometer=jaxcal.magnetometer.MagModel(np.eye(3), np.array([bias, 0.0, 0.0])))
    >>> (part,) = jaxcal.calibration.difference(device(1e-6), device(3e-6))
    >>> part.name, [name for name, change in zip(part.parameters, part.change) if change]
    ('magnetometer', ['hard iron x'])
    """

    name: str
    parameters: tuple[str, ...]
    quantities: tuple[str, ...]
    first: AnyArray
    second: AnyArray
    standard_error: AnyArray
    chi_square: float
    degrees_of_freedom: int
    probability: float
    findings: tuple[Finding, ...] = eqx.field(static=True)

    @property
    def change(self) -> AnyArray:
        """(p,) second - first."""
        return self.second - self.first


class Difference(Result):
    """Changes from one calibration to another: a sequence of `PartDifference`, rendered as one result.

    Attributes
    ----------
    parts : for each part that both calibrations have, its `PartDifference`.
    significance : probability below which a change counts as one.
    findings : "changed" for each part that changed, and what to know about the comparison.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> device = jaxcal.Calibration(magnetometer=jaxcal.magnetometer.MagModel(np.eye(3), np.array([1e-6, 0.0, 0.0])))
    >>> jaxcal.calibration.difference(device, device).headline
    'no change beyond chance was found in what has a covariance'
    """

    parts: tuple[PartDifference, ...]
    significance: float
    findings: tuple[Finding, ...] = eqx.field(static=True)

    def __iter__(self) -> Iterator[PartDifference]:
        return iter(self.parts)

    def __len__(self) -> int:
        return len(self.parts)

    def __getitem__(self, place: int) -> PartDifference:
        return self.parts[place]

    @property
    def headline(self) -> str:
        """The parts that changed."""
        changed = [name for one in self.findings if one.code == "changed" for name in one.subject]
        return f"changed: {', '.join(changed)}" if changed else "no change beyond chance was found in what has a covariance"

    def sections(self) -> list[Section]:
        """A table for each part: both values, and the change with its interval."""
        return [_grid(part) for part in self.parts]


def _grid(part: PartDifference) -> Grid:
    rows = []
    for name, quantity, a, b, error in zip(part.parameters, part.quantities, part.first, part.second, part.standard_error, strict=True):
        half, key, change = NORMAL95 * float(error), f"{part.name}.{name}", float(b - a)
        state = "held" if error == 0 else "estimated"
        cells = [Number(f"{key}.{which}", float(x), quantity=quantity) for which, x in (("first", a), ("second", b))]
        rows.append((name, (*cells, Number(f"{key}.change", change, change - half, change + half, quantity, state))))
    known = part.degrees_of_freedom > 0
    note = f"chi-square {part.chi_square:.4g} of {part.degrees_of_freedom}, probability {part.probability:.2g}" if known else ""
    return Grid(part.name, part.name, ("first", "second", "change"), tuple(rows), note=note)


@host_float64
def difference(a: Calibration, b: Calibration, *, significance: float = 0.01) -> Difference:
    r"""Changes from one calibration to another, part by part, with their significance.

    .. math:: \chi^2 = (\theta_b - \theta_a)^T (P_a + P_b)^{+} (\theta_b - \theta_a)

    Parameters
    ----------
    a, b : two calibrations of one device, from different recordings. Only parts that both contain are compared.
    significance : probability below which a change counts as one.

    Returns
    -------
    Difference, with one `PartDifference` for each part. A magnetometer is compared by its symmetric correction, with the field of `a` for
    both, and by its hard iron; noise by the squares of its coefficients; thermal models by their largest difference, without a covariance.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> def device(bias):
    ...     names = [f"matrix[{i},{j}]" for i in range(3) for j in range(3)] + [f"bias[{i}]" for i in range(3)]
    ...     covariance = {"parameters": names, "values": 1e-4 * np.eye(12)}
    ...     part = {"unit": "m/s^2", "matrix": np.eye(3), "bias": np.array([bias, 0, 0]), "covariance": covariance}
    ...     return jaxcal.Calibration(imu={"accel": part})
    >>> (accel,) = jaxcal.calibration.difference(device(0.1), device(0.15))
    >>> round(accel.chi_square, 3), accel.degrees_of_freedom, round(accel.probability, 3)
    (12.5, 12, 0.406)

    References
    ----------
    Chi-square of a difference of independent estimates: any text on statistics, e.g. C. R. Rao, Linear Statistical Inference, 6a.
    """
    shared = _same_recording(a, b)
    found = []
    if a.imu is not None and b.imu is not None:
        others = b.imu.parts
        found += [_by_leaves(sensor, part, others[sensor], shared) for sensor, part in a.imu.parts.items() if sensor in others]
    if a.magnetometer is not None and b.magnetometer is not None:
        pair = a.magnetometer, b.magnetometer
        if pair[0].unit != pair[1].unit:
            raise DataError(f"one magnetometer is calibrated in {pair[0].unit}, the other in {pair[1].unit}", code="units_differ")
        # the soft iron of magnitudes has an arbitrary rotation; that of a device, or of a model object, is one in known axes
        free = any(one.estimate is None or "field" in one.estimate for one in pair)
        compared = _magnetometer if free and not any(one.further for one in pair) else partial(_by_leaves, "magnetometer")
        found.append(compared(*pair, shared))
    if a.noise is not None and b.noise is not None:
        for sensor in ("gyro", "accel", "mag"):
            one, other = getattr(a.noise, sensor), getattr(b.noise, sensor)
            if one is not None and other is not None:
                found += [part for i in range(3) if (part := _noise(sensor, i, one, other, shared)) is not None]
    if a.temperature is not None and b.temperature is not None:
        found += [part for sensor in ("gyro", "accel") if (part := _temperature(sensor, a.temperature, b.temperature)) is not None]
    said = [one.of(part.name) for part in found for one in part.findings]
    for part in found:
        if part.probability < significance:
            facts = {"chi": part.chi_square, "freedom": part.degrees_of_freedom, "chance": part.probability}
            said.append(FINDINGS("changed", part.name, part.chi_square, **facts))
    return Difference(tuple(found), significance, tuple(said))


def _by_leaves(sensor: str, a: Part[Any], b: Part[Any], notes: Sequence[Finding]) -> PartDifference:
    """Compare the fields of the models; for a magnetometer, only the fitted ones."""
    held = [part.parameters for part in (a, b)]
    names = [name for name in held[0] if name in held[1] and (sensor == "gyro" or not name.startswith("g_sensitivity"))]
    if sensor == "magnetometer" and a.estimate is not None and b.estimate is not None:
        names = [name for name in names if name in a.estimate and name in b.estimate]
    units = quantities_of(sensor, a, names)
    first, second = (np.array([values[name] for name in names]) for values in held)
    spread, said = _sum([part.spread(names) for part in (a, b)])
    return _part(sensor, names, units, first, second, spread, (*notes, *_unequal(a, b), *said))


def _unequal(a: Part[Any], b: Part[Any]) -> list[Finding]:
    """Whether the two models are of different classes."""
    first, second = (type(part.model).__name__ for part in (a, b))
    return [] if first == second else [FINDINGS("classes", first=first, second=second)]


def _magnetometer(a: Part[Any], b: Part[Any], notes: Sequence[Finding]) -> PartDifference:
    """Compare the root W of the ellipsoid's matrix A = W W, times the field of `a`; dA = W dW + dW W gives the covariance."""
    said = [*notes, *_unequal(a, b)]
    known = all(part.field is not None and np.isfinite(part.field) for part in (a, b))
    if not known:
        said.append(FINDINGS("no_field"))
    further = [name for name in a.further if name in b.further]
    names = ["correction " + _AXES[i] + _AXES[j] for i, j in _QUADRIC] + [f"hard iron {axis}" for axis in _AXES] + further
    values, spreads, turns = [], [], []
    for part in (a, b):
        turn, shape = scipy.linalg.polar(np.linalg.inv(part.model.soft_iron))
        scale = a.field / part.field if known else 1.0  # type: ignore[operator]
        turns.append(turn)
        numbers = part.parameters
        values.append(np.array([*(scale * _entries(shape)), *part.model.hard_iron, *(numbers[name] for name in further)]))
        held = part.spread([*SOFT, "field", *HARD, *further])
        strength = part.field if part.field else np.nan
        if held is not None:
            soft = part.model.soft_iron
            held = _of_root(held, soft, strength, shape / strength, scale * strength) if np.isfinite(strength) else None
        spreads.append(held)
    turned = turns[1] @ turns[0].T
    angle = np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1.0, 1.0)))
    if angle > 1e-3:
        said.append(FINDINGS("turned", angle=angle))
    spread, more = _sum(spreads)
    units = ["ratio"] * 6 + quantities_of("magnetometer", a, [*HARD, *further])
    return _part("magnetometer", names, units, values[0], values[1], spread, (*said, *more))


def _of_root(spread: AnyArray, soft: AnyArray, field: float, root: AnyArray, scale: float) -> AnyArray:
    """Covariance of scale * W, with A = W W = (C C')^-1 / H^2, and of what follows, from that of C by rows, H, and what follows."""
    a, change = root @ root, np.eye(9).reshape(9, 3, 3) @ soft.T
    moved = [*(-(field**2) * a @ (change + np.swapaxes(change, 1, 2)) @ a), -2 * a / field]
    slope = np.zeros((len(spread) - 4, len(spread)))
    slope[:6, :10] = scale * np.transpose([_entries(scipy.linalg.solve_sylvester(root, root, one)) for one in moved])
    slope[6:, 10:] = np.eye(len(spread) - 10)
    return slope @ spread @ slope.T


def _entries(matrix: AnyArray) -> AnyArray:
    return matrix[tuple(np.transpose(_QUADRIC))]


def _noise(sensor: str, i: int, a: Any, b: Any, notes: Sequence[Finding]) -> PartDifference | None:
    terms = [t for t in "QNBKR" if all(getattr(one, t) is not None and np.isfinite(getattr(one, t)[i]) for one in (a, b))]
    if not terms:
        return None
    first, second = (np.array([getattr(one, term)[i] for term in terms]) for one in (a, b))
    squares = []
    for one in (a, b):
        known = None if one.covariance is None or not np.isfinite(one.covariance.values[i]).all() else one.covariance
        where = [] if known is None else [known.parameters.index(f"{term}^2") for term in terms]
        squares.append(None if known is None else known.values[i][np.ix_(where, where)])
    spread, said = _sum(squares)
    units = [f"{term}.{sensor}" for term in terms]
    part = _part(f"noise {sensor}_{_AXES[i]}", terms, units, first**2, second**2, spread, (*notes, *said))
    with np.errstate(divide="ignore", invalid="ignore"):
        # first-order error of each coefficient, from that of its square
        known = [np.diag(s) / (4 * value**2) for s, value in zip(squares, (first, second), strict=True) if s is not None]
        error = np.sqrt(np.sum(known or [np.full(len(terms), np.nan)], axis=0))
    error = np.where(np.isfinite(error), error, np.nan)
    return dataclasses.replace(part, first=first, second=second, standard_error=error)


def _temperature(sensor: str, a: Thermal, b: Thermal) -> PartDifference | None:
    low, high = max(a.minimum, b.minimum), min(a.maximum, b.maximum)
    if not low < high:
        return None
    t = np.linspace(low, high, 201)
    curves = [_curve(thermal, sensor, t) for thermal in (a, b)]
    if any(curve is None for curve in curves):
        return None
    where = np.argmax(np.abs(curves[1] - curves[0]), axis=1)
    first, second = (curve[np.arange(3), where] for curve in curves)
    names = [f"{sensor}_{axis} at {t[k]:.4g} degC" for axis, k in zip(_AXES, where, strict=True)]
    return _part(f"temperature {sensor}", names, [f"B.{sensor}"] * 3, first, second, None, [FINDINGS("range", low=low, high=high)])


def _curve(thermal: Thermal, sensor: str, t: AnyArray) -> Any:
    """Change of the bias of the three axes since the middle of `t`, (3, n); None if an axis has no model."""
    models = thermal.of(sensor)
    if len(models) < len(_AXES):
        return None
    found = np.stack([np.asarray(model.curve.value(np.clip(t, model.low, model.high))) for model in models.values()])
    return found - found[:, [len(t) // 2]]


def _sum(spreads: Sequence[AnyArray | None]) -> tuple[AnyArray | None, list[Finding]]:
    known = [spread for spread in spreads if spread is not None]
    if not known:
        return None, [FINDINGS("no_covariance")]
    missing = [name for name, spread in zip(("first", "second"), spreads, strict=True) if spread is None]
    said = [FINDINGS("one_covariance", which=missing[0])] if missing else []
    return sum(known[1:], start=known[0]), said


def _part(
    name: str, names: Sequence[str], units: Sequence[str], first: AnyArray, second: AnyArray, spread: AnyArray | None,
    notes: Sequence[Finding],
) -> PartDifference:  # fmt: skip
    """Form the chi-square in the space that the covariance spans; parameters that a convention fixes do not count."""
    error, chi, freedom, probability, said = np.full(len(names), np.nan), np.nan, 0, np.nan, list(notes)
    if spread is not None:
        error = np.sqrt(np.maximum(np.diag(spread), 0.0))
        free = error > 0
        change = (second - first)[free] / error[free]
        fixed = np.abs(second - first)[~free]
        if np.any(fixed > 1e-9 * np.maximum(np.abs(first[~free]), 1.0)):
            said.append(FINDINGS("conventions"))
        if free.any():
            size, ways = np.linalg.eigh(spread[np.ix_(free, free)] / np.outer(error[free], error[free]))
            kept = size > _RANK * size[-1]
            along = ways.T @ change
            chi, freedom = float(np.sum(along[kept] ** 2 / size[kept])), int(kept.sum())
            probability = float(scipy.special.chdtrc(freedom, chi))
            if np.any(np.abs(along[~kept]) > 1e-2):
                said.append(FINDINGS("outside"))
    return PartDifference(name, tuple(names), tuple(units), np.asarray(first), np.asarray(second), error, chi, freedom, probability,
                          tuple(said))  # fmt: skip


def _same_recording(a: Calibration, b: Calibration) -> list[Finding]:
    known = [(one.provenance or {}).get("sha256") for one in (a, b)]
    return [FINDINGS("same_recording")] if known[0] is not None and known[0] == known[1] else []
