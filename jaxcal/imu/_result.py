"""`ImuFit`, the result of a calibration, and the findings that judge it."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar

import equinox as eqx
import numpy as np

from .._answer import CAUTION, FATAL, Curve, Finding, Number, Quantity, Result, Section, by_axis, listed
from .._types import AnyArray
from .._units import STANDARD_GRAVITY
from ..evidence._rests import StillIntervals
from ..fitting import Estimate, Fit, Outcome, identifiability
from ._findings import FINDINGS
from ._model import LEVEL, Imu, Triad
from ._observability import Observability
from ._prior import conflict

#: relative standard error above which the verdict is weak, and above which a matrix counts as unknown
POOR, UNKNOWN = FINDINGS["poor"].limits
#: gravity on Earth differs by this share between the equator and the poles (WGS 84: 9.780 to 9.832 m/s^2)
GRAVITY_RANGE = 0.003
_SENSORS = {"accel": "accelerometer", "gyro": "gyroscope"}
LABELS = {"g_sensitivity": "g-sensitivity"}


def quantities(counts: bool = False) -> dict[str, str]:
    """Quantity of each field of the sensors, for readings in SI or in counts."""
    known = {"accel": "m/s^2", "gyro": "rad/s"}
    if counts:
        found = {f"{sensor}.matrix": f"counts per {unit}" for sensor, unit in known.items()}
        return found | dict.fromkeys(("accel.bias", "gyro.bias"), "counts") | {"gyro.g_sensitivity": "counts per m/s^2"}
    found = {"accel.bias": "accel", "gyro.bias": "gyro", "gyro.g_sensitivity": "gyro/accel"}
    for sensor, unit in known.items():
        found |= {f"{sensor}.quadratic": f"1/({unit})", f"{sensor}.cubic": f"1/({unit})^2"}
    return found


def nothing() -> Estimate:
    """An estimate without parameters."""
    return Estimate((), np.zeros(0), np.zeros((0, 0)))


def _unknown(*shape: int, fill: float = np.nan) -> Any:
    return eqx.field(default_factory=lambda: np.full(shape, fill))


class ImuFit(Result):
    """Accelerometer and gyroscope, calibrated from a recording of still poses and the turns between them.

    Attributes
    ----------
    findings : what to know about the calibration; the worst one gives the `verdict`.
    accel, gyro : `Triad`s, or the subclasses that were fitted, in the frame of `convention`; None if the recording does not determine
        the sensor, or has no gyroscope.
    estimate : `jaxcal.fitting.Estimate` of the parameters, such as "accel.matrix[0,1]", "gyro.bias[2]", "gyro.g_sensitivity[0,0]" and the
        fields of subclasses, in units of the readings per SI; "held" if the convention or an option fixes a parameter. Poses and turns
        count as independent; errors common to all samples of a still interval are included.
    residual_norm : (k,) gravity minus the magnitude of the corrected specific force of each pose, m/s^2.
    residual_turn : (s,) angle after each turn between the vertical predicted by the gyroscope and that of the accelerometer, rad.
    residual_rest : (k, 3) rates at rest minus the model, rad/s.
    sigma : (3,) standard deviations of these three residuals for one pose or turn: m/s^2, rad, rad/s.
    down_weighted : two index arrays, the poses and the turns whose weight under the robust loss is below one half.
    held_out : (2,) rms error on poses and turns left out of the fit: magnitude (m/s^2) and components of the turns (rad).
    held_out_turn : (s,) the angle after each turn (rad) where it was left out of the fit; empty or NaN if no turn was.
    still : the `StillIntervals` that the fit used.
    observability : `Observability`: condition, missing attitudes, sentence.
    drift : (3,) drift of the gyroscope's bias, rad/s per s; zero if the F test finds none.
    asked : names of terms that the log supports and the model lacks; pass them as `terms`.
    rate : Hz. gravity : m/s^2.
    temperature : mean of the recording, degC; NaN if it was not recorded.
    convention : frame of the result. method : "joint", "ferraris" or "six_position".

    Examples
    --------
    >>> import jaxcal
    >>> log = jaxcal.imu.simulate(poses=4, rate=50, still=3, turn=2, seed=0)
    >>> found = jaxcal.imu.multi_position(log, gravity=9.81)
    >>> found.verdict, sorted(found.codes)
    ('refused', ['few_rests'])
    """

    rate: float
    gravity: float
    temperature: float
    convention: str = eqx.field(static=True)
    method: str = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())
    accel: Triad | None = None
    gyro: Triad | None = None
    estimate: Estimate = eqx.field(default_factory=nothing)
    residual_norm: AnyArray = _unknown(0)
    residual_turn: AnyArray = _unknown(0)
    residual_rest: AnyArray = _unknown(0, 3)
    sigma: AnyArray = _unknown(3)
    down_weighted: tuple[Any, Any] = (np.zeros(0, dtype=int), np.zeros(0, dtype=int))
    held_out: AnyArray = _unknown(2)
    held_out_turn: AnyArray = _unknown(0)
    still: StillIntervals | None = None
    observability: Observability | None = None
    drift: AnyArray = _unknown(3, fill=0.0)
    asked: tuple[str, ...] = eqx.field(static=True, default=())

    _figure: ClassVar[tuple[str, bool] | None] = ("imu", False)

    @property
    def model(self) -> Imu:
        """Both sensors."""
        return Imu(self.accel, self.gyro)

    @property
    def headline(self) -> str:
        """How well the scale factors are known: half of the 95 % interval, or the uncertainty of an assumed gravity."""
        known = {sensor: scale_error(self.estimate, f"{sensor}.") for sensor in _SENSORS if getattr(self, sensor) is not None}
        if self.verdict == "refused" or not known:
            return ""
        said = {sensor: f"{_SENSORS[sensor]} scale to {parts_of(error)}" for sensor, error in known.items()}
        if "gravity_assumed" in self.codes and known["accel"] < GRAVITY_RANGE:
            said["accel"] = f"accelerometer scale to {parts_of(GRAVITY_RANGE)}, since gravity is assumed"
        return ", ".join(said.values())

    def sections(self) -> list[Section]:
        """The parameters of each sensor, the sizes of the residuals, and the residuals of poses and turns."""
        found: list[Section] = [
            by_axis(sensor, title, part.numbers(), LABELS)
            for sensor, title in _SENSORS.items() if (part := self.estimate.select(f"{sensor}.*")).names
        ]  # fmt: skip
        kinds = (("magnitude at rest", "norm", "accel"), ("angle after a turn", "turn", "angle"), ("rate at rest", "rest", "gyro"))
        sizes = [(label, Number(f"sigma.{name}", float(size), quantity=quantity))
                 for (label, name, quantity), size in zip(kinds, self.sigma, strict=True) if np.isfinite(size)]  # fmt: skip
        left = [(label, Number(f"held_out.{name}", float(size), quantity=quantity))
                for (label, name, quantity), size in zip(kinds, self.held_out, strict=False) if np.isfinite(size)]  # fmt: skip
        found += [listed("held_out", "errors where left out of the fit", left)] if left else []
        found.append(listed("sizes", "standard deviation of one residual", sizes, detail=True))
        if len(self.residual_norm):
            poses: Mapping[str, Any] = {"pose": ("", np.arange(1, len(self.residual_norm) + 1)), "norm": ("accel", self.residual_norm)}
            rests = np.asarray(self.residual_rest).T if len(self.residual_rest) else ()
            rates = {f"rate {axis}": ("gyro", x) for axis, x in zip("xyz", rests, strict=False)}
            found.append(Curve("poses", "the poses", {**poses, **rates}))
        if len(self.residual_turn):
            turns = {"turn": ("", np.arange(1, len(self.residual_turn) + 1)), "angle": ("angle", self.residual_turn)}
            found.append(Curve("turns", "the turns", turns))
        return found


def assumed_gravity(gravity: Any) -> tuple[float, tuple[Finding, ...]]:
    """Gravity in m/s^2, and a finding if it was not given."""
    if gravity is not None:
        return gravity, ()
    return STANDARD_GRAVITY, (FINDINGS("gravity_assumed", cost=GRAVITY_RANGE, gravity=Quantity(STANDARD_GRAVITY, "accel")),)


def judged(
    result: ImuFit, fit: Fit, options: Any, notes: Iterable[Finding], causes: Callable[[], Sequence[Finding]],
    missing: Iterable[Finding] = ()
) -> ImuFit:  # fmt: skip
    """Add the findings on a fit.

    `causes` finds a unit or an order of axes that would repair a refused fit; `missing` are terms that the model lacks.
    """
    seen: Any = result.observability
    gyro, poses, turns = result.gyro is not None, len(result.residual_norm), len(result.residual_turn)
    errors = {sensor: matrix_error(result.estimate, sensor) for sensor in (("accel", "gyro") if gyro else ("accel",))}
    rms = float(np.sqrt(np.mean(result.residual_turn**2))) if turns else 0.0
    found: list[Finding] = []
    if not bool(fit.usable) and fit.outcome != Outcome.unidentifiable:
        found.append(FINDINGS("failed", why=fit.message))
    found += FINDINGS.over("turns_disagree", rms, angle=Quantity(rms, "angle"))
    if gyro and not found and not errors["gyro"] <= UNKNOWN:
        found.append(FINDINGS("gyro_open"))
    if fit.outcome == Outcome.unidentifiable and not found and (seen.determined or options.prior is not None):
        found.append(FINDINGS("parameters_open", what=identifiability(fit).sentence))
    elif not errors["accel"] <= UNKNOWN:
        found.append(dataclasses.replace(seen.finding, severity=FATAL))
    notes = list(notes)
    if found or any(one.code == "range" for one in notes):
        found += (known := causes())
        notes = [one for one in notes if not known or one.code != "range"]  # another unit or order of axes explains the scales, too
    if options.prior is None:
        found += FINDINGS.over("few_poses", -float(poses), cost=0.0, poses=poses) if options.misalignment else []
    elif (level := conflict(fit)) < LEVEL:
        found.append(FINDINGS("prior_conflict", level=level))
    found += [FINDINGS("poor", sensor, cost=error, error=parts_of(error)) for sensor, error in errors.items() if POOR < error <= UNKNOWN]
    if POOR < errors["accel"] <= UNKNOWN:
        found.append(dataclasses.replace(seen.finding, severity=CAUTION))
    for what, which, count in zip(("poses", "turns"), result.down_weighted, (poses, turns), strict=True):
        found += FINDINGS.over("disagree", len(which) / max(count, 1), count=len(which), total=count, what=what)
    for sensor, what, size, usual in zip(("accel", "gyro"), ("poses", "turns"), result.held_out, result.sigma, strict=False):
        left = Quantity(float(size), "angle" if sensor == "gyro" else sensor)
        found += FINDINGS.over("held_out", size / max(usual, 1e-12), sensor, what=what, size=left, ratio=float(size / max(usual, 1e-12)))
    scatter = float(result.sigma[0])
    found += FINDINGS.over("scatter", scatter, "accel", sigma=Quantity(scatter, "accel"))
    return dataclasses.replace(result, findings=(*result.findings, *found, *missing, *notes))


def matrix_error(estimate: Estimate, sensor: str) -> float:
    """Largest standard error of the entries of a sensor's matrix, relative to the scale of the axis."""
    part = estimate.select(f"{sensor}.matrix*")
    matrix = np.asarray(part.values).reshape(3, 3)
    return float(np.max(part.error.reshape(3, 3) / np.abs(np.diag(matrix))[:, None]))


def scale_error(estimate: Estimate, sensor: str = "") -> float:
    """Half of the widest 95 % interval of the scale factors, relative to them; names begin with `sensor`."""
    scales = [estimate[f"{sensor}matrix[{i},{i}]"] for i in range(3)]
    return max(one.half / abs(one.value) for one in scales)


def parts_of(value: float) -> str:
    """Format a ratio in % or ppm."""
    return f"{100 * value:.2g} %" if value >= 1e-3 else f"{float(f'{1e6 * value:.2g}'):g} ppm"
