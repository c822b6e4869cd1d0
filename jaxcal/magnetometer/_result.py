"""`MagFit`: a magnetometer calibration with its uncertainty, and the verdict good, weak or refused with its reasons."""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from .._results import Result, Row
from .._special import student_quantile
from .._types import AnyArray
from .._units import STRONGEST_FIELD
from ..fitting._serial import BLOCKS, doubt
from ._design._heading_error import Information, heading_error
from ._ellipsoid._algebraic import NotEllipsoid, ellipsoid_of, extents, nearest_quadric, sampson
from ._ellipsoid._causes import Examined
from ._ellipsoid._kinds import COUNT, ENTRIES, NAMES, PLANAR
from ._ellipsoid._shape import Found, radius_of, soft_iron_slopes
from ._model import MagModel

NOT_JUDGED = "The fit was traced: nothing was chosen and nothing is judged. Call `fit` outside of jit, vmap and grad for a verdict."
#: rms heading error in rad above which a verdict is "weak", and above which it is "refused"
LIMITS = (np.deg2rad(1.0), np.deg2rad(5.0))
NEAR_PLANAR = 0.05  # smallest singular value of the centred readings; it is 0.58 for a full sphere
NEAR_PLANAR_SENTENCE = (
    "The readings are near-planar: they leave the field across their plane open. Turn about a second axis, or use model='planar'."
)
_OUTLIER = 4.0
_ONE = 1e-9
#: change of a symmetric matrix with each of its entries xx, xy, xz, yy, yz, zz
_UPPER = np.zeros((6, 3, 3))
_UPPER[range(6), *np.triu_indices(3)] = _UPPER[range(6), *np.triu_indices(3)[::-1]] = 1.0
_MANY_OUTLIERS = 0.01
_NOISY, _TOO_NOISY = 0.1, 0.2
_ILL, _SINGULAR = 1000.0, 1e8
_BY_NOISE = 0.5
_BY_PENALTY, _CONFLICT = 0.5, 3.0  # standard errors
UNEVEN = "The residuals are not white, and parts of the log differ"
_BY_BIAS = 1.5  # factor by which an error may exceed the biases that were found


class MagFit(Result):
    """Hard and soft iron with their uncertainty, the heading error to expect, and a verdict.

    Field magnitudes cannot show a rotation common to all readings. Without an `alignment`, `model` has a symmetric soft iron, and
    `heading_error` covers the errors of the hard iron and of the symmetric soft iron only.

    Attributes
    ----------
    model : `MagModel`; None if the readings determine none.
    covariance : (9, 9) of A_xx, A_xy, A_yy, A_xz, A_yz, A_zz and the hard iron, in units of the readings (see `names`); the ellipsoid is
        (m - b)'A(m - b) = 1. It includes what a smaller model may leave out, and the squared biases from `causes`. It assumes white
        noise if the residuals are white; otherwise it comes from fits without parts of the log (see `blocks`). In a plane (5, 5).
    heading_error : (2,) predicted rms error of the heading in rad, at level and at 20 degrees of tilt. It holds for the dip `inclination`,
        readings without noise and a true vertical. For methods other than "ml" and "consistent" it includes their difference from "ml".
    coverage : `Coverage` of the corrected readings; None without a model.
    residual : (n,) orthogonal distance of each reading to the ellipsoid, in the unit of the readings, positive outside.
    noise : standard deviation of one axis of a reading, in its unit.
    verdict : "good", "weak" or "refused"; "not judged" under `jit`, `vmap` and `grad`, where coverage, outliers, `needed` and
        `condition` are left empty.
    reason : one or more sentences that explain the verdict.
    field : magnitude of the corrected field: as given, or the cube root of the product of the ellipsoid's semi-axes.
    outliers : indices of readings more than four robust standard deviations off, or with a weight below 0.33.
    causes : name -> rms heading error in rad that it adds at level, for each cause that the residuals follow beyond chance, the strongest
        first: "drift", a name of `conditions`, "rate of turn", "nonlinearity"; then "place", "current or moving part" or "correlated
        noise" if the remaining residuals are not white. Also "clipping", with readings at the end of the sensor's range.
    blocks : number of parts of the log that were left out in turn for `covariance`; zero if the residuals are white.
    used : number of readings that were fitted. Long logs are thinned.
    needed : (3, 3) unit vectors, in the corrected field's axes, in which further readings would help most.
    condition : condition number of the fit on the unit sphere. 3 for even coverage; above 1000 the readings hardly determine the model.
    inclination : dip of the field used for `heading_error`, rad: as given, from the accelerometer, or 57 degrees.
    down : (3,) axis that points down at level, used for `heading_error`, in the axes of the magnitude fit (before the rotation by
        `alignment`): z, or the mean vertical of an accelerometer if it tilts little.
    heading_range : (2,) smallest and largest `heading_error` at level, over all unknown assumptions: dips up to 75 degrees, and each axis
        down. NaN in a plane and for model objects.
    terms : name of a current -> (2, 3): field per unit of the current, and its standard deviation, in the unit of the readings; from
        `fit_current`.
    check : `Check` of readings that were held back from the fit; None otherwise.
    usual : median of each condition of a model object; `heading_error` holds at these values.
    plane : (3, 3) for a planar fit: two unit vectors in the plane, then its normal. None otherwise.
    alignment : `Alignment` with the given accelerometer, gyroscope or headings; `model` includes its rotation. None otherwise.
    warnings : sentences.
    names : names of the parameters of `covariance`.
    field_error : relative standard deviation with which the given field took part in the fit; None if the field only sets the scale.
    penalty : weight of the penalty against few directions; zero if the readings alone decided.
    joint : whether magnitudes and the other sensor were fitted together. `heading_error` then includes the correlation of ellipsoid and
        rotation.
    values : values of the parameters in `names`; `parameters` and `interval` give them by name.
    method, kind : name of the method; "sphere", "diagonal", "symmetric", or in a plane "circle" and "ellipse".

    Examples
    --------
    >>> from jaxcal.magnetometer import body_field, fit, scenario
    >>> found = fit(body_field(scenario("all"), 50e-6))
    >>> found.verdict, found.kind, f"{found.field:.1e} T"
    ('good', 'sphere', '5.0e-05 T')
    """

    model: MagModel | None
    covariance: AnyArray
    heading_error: AnyArray
    coverage: Any
    residual: AnyArray
    noise: float | AnyArray
    field: float | AnyArray
    outliers: AnyArray
    used: int
    needed: AnyArray
    condition: float
    inclination: float
    plane: Any
    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    method: str = eqx.field(static=True)
    kind: str = eqx.field(static=True)
    alignment: Any = None
    penalty: float = 0.0
    field_error: float | None = None
    joint: bool = eqx.field(static=True, default=False)
    values: AnyArray = eqx.field(default_factory=lambda: np.zeros(0))
    causes: dict[str, float] = eqx.field(default_factory=dict)
    blocks: int = eqx.field(static=True, default=0)
    down: AnyArray = eqx.field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    heading_range: AnyArray = eqx.field(default_factory=lambda: np.full(2, np.nan))
    usual: dict[str, Any] = eqx.field(default_factory=dict)
    terms: dict[str, Any] = eqx.field(default_factory=dict)
    check: Any = None

    @property
    def parameters(self) -> dict[str, float]:
        """Value of each parameter by its name, in the units of the readings."""
        values = np.asarray(self.values)
        if self.model is not None and not len(values):
            basis = np.eye(3) if self.plane is None else np.asarray(self.plane)[:2]
            matrix = np.linalg.inv(np.asarray(self.model.soft_iron)) @ basis.T / self.field
            entries = tuple(place[: len(self.names) - len(basis)] for place in ENTRIES)
            values = np.concatenate([(matrix.T @ matrix)[entries], basis @ np.asarray(self.model.hard_iron)])
        return dict(zip(self.names, values.tolist(), strict=True)) if len(values) else {}

    @property
    def interval(self) -> dict[str, tuple[float, float]]:
        """95 % interval of each parameter by its name: (low, high), by Student's t."""
        if self.model is None:
            return {}
        half = self._quantile * np.sqrt(np.diag(self.covariance))
        return {name: (value - h, value + h) for (name, value), h in zip(self.parameters.items(), half.tolist(), strict=True)}

    @property
    def _quantile(self) -> float:
        """Half of a 95 % interval in standard deviations, by Student's t."""
        freedom = self.blocks - 1 if self.blocks else max(self.used - len(self.names), 1)
        return float(student_quantile(freedom, 0.975))

    _figure = ("sphere", True)

    def _rows(self) -> list[Row]:
        if self.model is None:
            return []
        hard, half = np.asarray(self.model.hard_iron), self._quantile * self.hard_iron_error
        unit = "T" if self.field < STRONGEST_FIELD else "unit of the readings"
        rows = [Row(f"hard iron {axis}", b, b - h, b + h, unit) for axis, b, h in zip("xyz", hard, half, strict=True)]
        soft = np.asarray(self.model.soft_iron)
        spread = self._quantile * self.soft_iron_error
        low, high = soft - spread, soft + spread
        rows += [Row(f"soft iron {a}{b}", soft[i, j], low[i, j], high[i, j]) for i, a in enumerate("xyz") for j, b in enumerate("xyz")]
        for name, (value, error) in self.terms.items():
            spread = self._quantile * np.asarray(error)
            rows += [Row(f"{name} {a}", v, v - h, v + h, "unit") for a, v, h in zip("xyz", np.asarray(value), spread, strict=True)]
        known = self.interval
        for field in dataclasses.fields(self.model)[2:]:  # the fields of a subclass, fitted or set
            values = np.asarray(getattr(self.model, field.name))
            for entry in np.ndindex(values.shape) if np.issubdtype(values.dtype, np.floating) else ():
                name = field.name + (f"[{','.join(map(str, entry))}]" if entry else "")
                rows.append(Row(name, values[entry], *known.get(name, (np.nan, np.nan))))
        return [*rows, Row("field", self.field, unit=unit), Row("noise of a reading", self.noise, unit=unit)]

    @property
    def hard_iron_error(self) -> np.ndarray:
        """(3,) standard deviation of the hard iron, in the unit of the readings; infinite along the normal of a planar fit."""
        if self.plane is None:
            return np.sqrt(np.diag(self.covariance)[6:9])
        if not np.isfinite(self.covariance).all():
            return np.full(3, np.inf)
        basis = np.asarray(self.plane)[:2]
        spread = np.sqrt(np.einsum("ik,ij,jk->k", basis, self.covariance[3:, 3:], basis))
        return np.where(np.abs(self.plane[2]) > 1e-6, np.inf, spread)

    @property
    def soft_iron_error(self) -> np.ndarray:
        """(3, 3) standard deviations of the soft iron, including the rotation by `alignment`; infinite where a plane determines nothing."""
        if self.model is None or not np.isfinite(self.covariance).all():
            return np.full((3, 3), np.inf)
        soft, covariance = np.asarray(self.model.soft_iron), np.asarray(self.covariance)
        if len(self.values):  # a model object has soft iron S Q, and S is fitted
            left, _, right = np.linalg.svd(soft)
            slopes = _UPPER @ (left @ right)
        else:
            plane = None if self.plane is None else np.asarray(self.plane)
            values, size = list(self.parameters.values()), 3 if plane is None else 2
            shape = np.zeros((size, size))
            rows, columns = (place[: len(values) - size] for place in ENTRIES)
            shape[rows, columns] = shape[columns, rows] = values[:-size]
            given = bool(plane is None and abs(abs(np.linalg.det(soft)) - 1) > _ONE)
            alone, slopes = soft_iron_slopes(shape, float(self.field), given, plane)
            slopes = slopes @ np.linalg.inv(alone) @ soft
        part = covariance[: len(slopes), : len(slopes)]
        variance = np.einsum("pij,pq,qij->ij", slopes, part, slopes)
        if self.alignment is not None and self.alignment.verdict != "refused":
            turned = soft @ np.cross(np.eye(3), np.eye(3)[:, None]).swapaxes(1, 2)
            variance = variance + np.einsum("pij,pq,qij->ij", turned, np.asarray(self.alignment.covariance), turned)
        error = np.sqrt(np.maximum(variance, 0.0))
        return error if self.plane is None else np.where(np.outer(*2 * [np.abs(self.plane[2]) > _ONE]), np.inf, error)

    def _widened(self, by: np.ndarray, limits: tuple[float, float], what: str, more: np.ndarray | None = None) -> "MagFit":
        """The fit with a further covariance `by` (9, 9), caused by `what`, added to its covariance, heading error and verdict.

        more : the further heading error, if it does not follow from `by`. The range over dips and axes grows in proportion.
        """
        assert self.model is not None
        values = list(self.parameters.values())
        shape = np.zeros((3, 3))
        shape[ENTRIES] = shape[ENTRIES[::-1]] = values[:6]
        further = np.asarray(heading_error(shape, by, self.inclination, self.down) if more is None else more)
        error = np.hypot(np.asarray(self.heading_error), further)
        reasons = Reasons([], [])
        reasons.heading(error, limits, f"; part of that is by {what}.")
        verdict = max(self.verdict, reasons.verdict, key=("good", "weak", "refused").index)
        span = self.heading_range * error[0] / np.asarray(self.heading_error)[0]
        reason = self.reason.replace(expected(np.asarray(self.heading_error)), expected(error))
        reason = reason.replace(between(self.heading_range), between(span))
        if verdict != self.verdict:
            reason = reasons.text(reason)
        return dataclasses.replace(
            self, covariance=self.covariance + by, heading_error=error, heading_range=span, verdict=verdict, reason=reason
        )


def between(span: AnyArray) -> str:
    """The range of a heading error in rad, as text in degrees."""
    low, high = np.rad2deg(span)
    return f"{low:.2g} to {high:.2g} degrees" if high < 30 else f"{low:.2g} to more than 30 degrees" if low < 30 else "more than 30 degrees"


def refusal(method: str, dip: float, reason: str) -> MagFit:
    """A fit without a model."""
    return MagFit(
        model=None, covariance=np.full((9, 9), np.inf), heading_error=np.full(2, np.inf), coverage=None, residual=np.zeros(0), noise=np.inf,
        field=np.inf, outliers=np.zeros(0, dtype=int), used=0, needed=np.zeros((0, 3)), condition=np.inf, inclination=dip, plane=None,
        verdict="refused", reason=reason, warnings=(), names=NAMES, method=method, kind="none",
    )  # fmt: skip


def expected(error: Any) -> str:
    """The expected heading error, in words."""
    level, tilted = np.rad2deg(error)
    where = f"at level and {tilted:.2g} at 20 degrees of tilt" if np.isfinite(tilted) else "in the plane"
    return f"heading error to expect is {level:.2g} degrees rms {where}"


class Reasons(NamedTuple):
    """Sentences that explain why a fit is refused or weak."""

    refused: list[str]
    weak: list[str]

    def add(self, grave: bool | np.bool_, sentence: str) -> None:
        """Add a sentence that refuses the fit if `grave`, or else makes it weak."""
        (self.refused if grave else self.weak).append(sentence)

    def heading(self, error: np.ndarray, limits: tuple[float, float], rest: str) -> bool:
        """Add a sentence and return True if the predicted heading error is too large."""
        (level, tilted), (least, most) = np.rad2deg(error), np.rad2deg(limits)
        if not level <= least:
            large = "by more than 30 degrees" if not level <= 30 else f"by {level:.2g} degrees rms"
            at = f" at level and {tilted:.2g} at 20 degrees of tilt" if level <= 30 and np.isfinite(tilted) else ""
            self.add(not level <= most, f"The heading would be wrong {large}{at}{rest}")
        return not level <= least

    def scatter(self, relative: float, surface: str = "ellipsoid") -> None:
        """Add a sentence if the noise, relative to the field, is too large."""
        if relative > _NOISY:
            grave = relative > _TOO_NOISY
            far = "; they do not lie on one" if grave else ""
            self.add(grave, f"The readings scatter by {100 * relative:.0f} % of the field about the best {surface}{far}.")

    def outliers(self, number: int, count: int, cure: str = "leave them out") -> None:
        """Add a sentence if there are more outliers than chance explains."""
        if number > max(_MANY_OUTLIERS * count, 2):
            self.weak.append(f"{number} of {count} readings are outliers; {cure}.")

    @property
    def verdict(self) -> str:
        """The verdict that follows from the sentences."""
        return "refused" if self.refused else "weak" if self.weak else "good"

    def text(self, otherwise: str) -> str:
        """All sentences, the gravest first, or `otherwise` if there are none."""
        return " ".join([*self.refused, *self.weak]) or otherwise


def outliers(distance: AnyArray, weight: Any = 1.0) -> np.ndarray:
    """Indices of readings more than four robust standard deviations off, or with a weight below 0.33; distances in scaled units."""
    size = np.abs(distance)
    return np.flatnonzero((size > max(_OUTLIER * 1.4826 * np.median(size), 1e-9)) | (np.asarray(weight) < 0.33))


def _other_quadric(found: Found, u: np.ndarray) -> str | None:
    """Which other quadric the readings lie on, if their distances to it are less than half of those to the ellipsoid."""
    kept = found.weight > 0.5
    theta = nearest_quadric(u[kept])
    try:
        ellipsoid_of(theta)
    except NotEllipsoid as error:
        far = np.sqrt(np.mean(found.distance[kept] ** 2))
        if far > 1e-6 and 2 * np.sqrt(np.mean(sampson(theta, u[kept]) ** 2)) < far:
            return str(error)
    return None


def _structural(found: Found, u: np.ndarray, told: Information, planar: bool) -> list[str]:
    """Reasons that lie in the geometry of the readings, for any noise."""
    if not planar and extents(u - u.mean(axis=0))[-1] < NEAR_PLANAR:
        return [NEAR_PLANAR_SENTENCE]
    if not planar and (other := _other_quadric(found, u)):
        return [f"{other[0].upper()}{other[1:]}, and they lie on it more than twice as close as on any ellipsoid."]
    if not told.condition <= _SINGULAR or not np.isfinite(found.covariance).all():
        return [f"The readings do not determine {told.weakest}."]
    if told.by_noise > _BY_NOISE:
        return [f"The readings show {told.weakest} through their noise only, and so do not determine it."]
    return []


def judge(
    found: Found, u: np.ndarray, error: np.ndarray, told: Information, limits: tuple[float, float], loss: Any, notes: list[str],
    said: Examined, swing: float,
) -> tuple[str, str]:  # fmt: skip
    """The verdict, and the sentences that explain it."""
    planar = found.kind in PLANAR
    reasons = Reasons(_structural(found, u, told, planar), list(notes))
    if not reasons.refused:
        _by_size(found, error, told, limits, reasons, said, swing)
    far = len(outliers(found.distance, found.weight))
    if far > 0.4 * len(u):
        reasons.refused.append(f"{far} of {len(u)} readings are outliers: no majority of the readings agrees.")
    elif loss is None:
        reasons.outliers(far, len(u), "use loss='huber' or 'tukey', or leave them out")
    text = reasons.text(f"The {expected(np.asarray(error))}, excluding a rotation common to all readings.")
    return reasons.verdict, text + (" It holds for headings in the plane of the readings only." if planar else "")


def _by_size(
    found: Found, error: np.ndarray, told: Information, limits: tuple[float, float], reasons: Reasons, said: Examined, swing: float
) -> None:
    """Add the reasons that are a matter of degree: scatter, predicted heading error, condition."""
    if not found.converged:
        reasons.refused.append(f"The fit did not converge: {found.message or 'it ran off, as fits of this cost do with partial coverage.'}")
    reasons.scatter(found.noise / radius_of(found.shape))
    level, least = np.rad2deg([error[0], limits[0]])
    if not reasons.heading(error, limits, f"; least certain is {told.weakest}."):
        _doubtful(found, level, least, reasons, said, swing)
    if found.conflict > _CONFLICT:
        reasons.weak.append(
            f"The field that the readings alone give is {found.conflict:.2g} standard errors from the given one: its unit, the "
            "sensitivity, or the field error is off."
        )
    if found.bias > _BY_PENALTY:
        size = f"by {found.bias:.2g} standard errors" if found.bias < 100 else "without limit"
        reasons.weak.append(f"The readings alone leave the ellipsoid open: the penalty on small coverage moved it {size}.")
    if told.condition > _ILL:
        reasons.weak.append(f"The readings hardly determine {told.weakest} (condition number {told.condition:.0f}).")


def _doubtful(found: Found, level: float, least: float, reasons: Reasons, said: Examined, swing: float) -> None:
    """Add a reason if the heading error may exceed the limit, given how well the error itself is known."""
    if said.blocks:
        by, why = doubt(BLOCKS - 1), UNEVEN
    elif said.causes:
        by, why = _BY_BIAS, f"The residuals follow {said.causes[0].name!r}"
    else:
        by = doubt(max(len(found.distance) - COUNT[found.kind], 1))
        why = f"{len(found.distance)} readings leave the noise uncertain by a factor of {by:.2g}"
    if level * by > least:
        reasons.weak.append(f"{why}: the heading may be wrong by {level * by:.2g} degrees rms.")
    elif (moved := by * np.rad2deg(swing)) > least:
        reasons.weak.append(
            "The noise is correlated as that of a hard iron that moves would be, by which the heading may be wrong by "
            f"{moved:.2g} degrees rms."
        )
