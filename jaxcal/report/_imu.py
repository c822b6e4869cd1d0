"""The figures of a multi-position calibration: residuals pose by pose and turn by turn."""

from typing import Any

import numpy as np

from .._units import STANDARD_GRAVITY
from ..imu import ImuFit
from ._charts import Chart, Curve, charts
from ._html import Markup, section

SUBJECT, PART = "Calibration", "imu"


def lead(found: ImuFit) -> str:
    """Subtitle of the page."""
    return f"{len(found.residual_norm)} poses, {len(found.residual_turn)} turns at {found.rate:.6g} Hz"


def figures(found: ImuFit, log: Any) -> tuple[list[Markup], list[Markup]]:
    """The residuals of turns and poses."""
    shown = _residuals(found) if found.accel is not None else []
    return [charts([one]) for one in shown[:2]], [section("Residuals", "residuals", charts(shown[2:]))] if shown[2:] else []


def known(found: ImuFit) -> dict[str, str]:
    """Method and rests of the calibration, and what its poses determine."""
    facts = {"Method": f"{found.method}, convention {found.convention}, gravity {found.gravity:.6g} m/s²"}
    if found.still is not None:
        below = f"below {found.still.multiple:g} times the variance at rest" if np.isfinite(found.still.multiple) else "as given"
        facts["Still intervals"] = f"{len(found.residual_norm)}, {below}"
    return facts if found.observability is None else facts | {"Attitudes": found.observability.sentence}


def _residuals(found: ImuFit) -> list[Chart]:
    """Residuals of every pose and turn; hollow dots mark those with a reduced weight in the robust loss."""
    down = [np.asarray(which, dtype=int) for which in found.down_weighted]

    def dots(name: str, values: Any, color: int, hollow: Any = ()) -> Curve:
        return Curve(name, "dots", np.arange(1, len(values) + 1), values, color=color, hollow=hollow)

    note = "Hollow: weighed down by the robust loss."
    norm, turns, out = -np.asarray(found.residual_norm), np.asarray(found.residual_turn), np.asarray(found.held_out_turn)
    shown = [
        Chart("imu-norm", "Norm of the specific force less gravity, at rest", f"One dot a pose; {found.sigma[0]:.2g} m/s² rms. {note}",
              "Pose", "Norm less gravity", (("mm/s²", 1e-3), ("mg", STANDARD_GRAVITY * 1e-3)), [dots("norm", norm, 0, down[0])])
    ]  # fmt: skip
    if found.gyro is not None and len(turns):
        angles = [dots("in the fit", turns, 0, down[1])]
        angles += [dots("left out of the fit", out, 1)] if np.isfinite(out).any() else []
        about = f"Between the vertical that the gyroscope predicts and the accelerometer's. {note}"
        units = (("deg", np.pi / 180), ("mrad", 1e-3))
        shown.insert(0, Chart("imu-turn", "Angle after each turn", about, "Turn", "Angle after the turn", units, angles))
    if found.gyro is not None and len(found.residual_rest):
        rates = np.asarray(found.residual_rest).T
        shown.append(
            Chart("imu-rest", "Still rate less the model", "One dot a pose and axis.", "Pose", "Still rate less model",
                  (("deg/h", np.pi / 180 / 3600), ("mdeg/s", np.pi / 180e3), ("rad/s", 1.0)),
                  [dots(axis, rate, i) for i, (axis, rate) in enumerate(zip("xyz", rates, strict=True))])
        )  # fmt: skip
    return shown
