"""Good, weak or refused, and why."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy.special

from ._design._heading_error import Information
from ._ellipsoid._algebraic import NotEllipsoid, ellipsoid_of, extents, nearest_quadric, sampson
from ._ellipsoid._orthogonal import Found
from ._ellipsoid._start import COUNT

NEAR_PLANAR = 0.05  # smallest singular value of the centred readings, of 0.58 for a full sphere
NEAR_PLANAR_SENTENCE = (
    "The readings are near-planar: they leave the field across their plane open. Turn about a second axis, or use model='planar'."
)
OUTLIER = 4.0
_MANY_OUTLIERS = 0.01
_NOISY, _TOO_NOISY = 0.1, 0.2
_ILL, _SINGULAR = 1000.0, 1e8
_BY_NOISE = 0.5
_BY_PENALTY, _CONFLICT = 0.5, 3.0  # standard errors


class Judgement(eqx.Module):
    """What to think of a fit."""

    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)


def outliers(found: Found) -> np.ndarray:
    """Readings off by four robust standard deviations, or with less than a third of their weight."""
    size = np.abs(found.distance)
    spread = 1.4826 * np.median(size)
    return np.flatnonzero((size > max(OUTLIER * spread, 1e-9)) | (found.weight < 0.33))


def _other_quadric(found: Found, u: np.ndarray) -> str | None:
    """Why the readings lie on another quadric than an ellipsoid, if they lie on it twice as close."""
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
    """Reasons that lie in the geometry of the readings, whatever their noise."""
    reasons = []
    if not planar:
        if extents(u - u.mean(axis=0))[-1] < NEAR_PLANAR:
            reasons.append(NEAR_PLANAR_SENTENCE)
        elif other := _other_quadric(found, u):
            reasons.append(f"{other[0].upper()}{other[1:]}, and they lie on it more than twice as close as on any ellipsoid.")
    if not reasons and (not told.condition <= _SINGULAR or not np.isfinite(found.covariance).all()):
        reasons.append(f"The readings do not determine {told.weakest}.")
    elif not reasons and told.by_noise > _BY_NOISE:
        reasons.append(f"The readings show {told.weakest} through their noise only, and so do not determine it.")
    return reasons


def judge(
    found: Found, u: np.ndarray, error: np.ndarray, told: Information, limits: tuple[float, float], loss: Any, planar: bool,
    notes: list[str],
) -> Judgement:  # fmt: skip
    """Verdict with the sentences that lead to it, the gravest first."""
    refused, weak = _structural(found, u, told, planar), list(notes)
    if not refused:
        _by_size(found, error, told, limits, planar, refused, weak)
    far = outliers(found)
    if len(far) > 0.4 * len(u):
        refused.append(f"{len(far)} of {len(u)} readings are outliers: no majority of the readings agrees.")
    elif loss is None and len(far) > max(_MANY_OUTLIERS * len(u), 2):
        weak.append(f"{len(far)} of {len(u)} readings are outliers; use loss='huber' or 'tukey', or leave them out.")
    note = ["It holds for headings in the plane of the readings only."] if planar else []
    if refused or weak:
        return Judgement("refused" if refused else "weak", " ".join([*refused, *weak, *note]))
    level, tilted = np.rad2deg(error)
    extent = f"{level:.2g} degrees rms" + (" in the plane" if planar else f" at level and {tilted:.2g} at 20 degrees of tilt")
    return Judgement("good", " ".join([f"The heading error to expect is {extent}, excluding a rotation common to all readings.", *note]))


def _by_size(found: Found, error: np.ndarray, told: Information, limits, planar: bool, refused: list[str], weak: list[str]) -> None:
    """Reasons that are a matter of degree: scatter, predicted heading error, condition."""
    relative = found.noise * np.linalg.det(found.shape) ** (1 / 6)
    level, tilted = np.rad2deg(error)
    if not found.converged:
        refused.append(f"The fit did not converge: {found.message or 'it ran off, as fits of this cost do with partial coverage.'}")
    if relative > _TOO_NOISY:
        refused.append(f"The readings scatter by {100 * relative:.0f} % of the field about the best ellipsoid; they do not lie on one.")
    elif relative > _NOISY:
        weak.append(f"The readings scatter by {100 * relative:.0f} % of the field about the ellipsoid.")
    freedom = max(len(found.distance) - COUNT[found.kind], 1)
    # five per cent of noise estimates are too small by this factor or more
    doubt = float(np.sqrt(freedom / (2 * scipy.special.gammaincinv(freedom / 2, 0.05))))
    least, most = np.rad2deg(limits)
    if not level <= least:
        large = "by more than 30 degrees" if not level <= 30 else f"by {level:.2g} degrees rms"
        at = "" if planar or not level <= 30 else f" at level and {tilted:.2g} at 20 degrees of tilt"
        (weak if level <= most else refused).append(f"The heading would be wrong {large}{at}; least certain is {told.weakest}.")
    elif level * doubt > least:
        weak.append(
            f"{len(found.distance)} readings leave the noise uncertain by a factor of {doubt:.2g}: the heading may be wrong by "
            f"{level * doubt:.2g} degrees rms."
        )
    if found.conflict > _CONFLICT:
        weak.append(
            f"The field that the readings alone give is {found.conflict:.2g} standard errors from the given one: its unit, the "
            "sensitivity, or the field error is off."
        )
    if found.bias > _BY_PENALTY:
        size = f"by {found.bias:.2g} standard errors" if found.bias < 100 else "without limit"
        weak.append(f"The readings alone leave the ellipsoid open: the penalty on small coverage moved it {size}.")
    if told.condition > _ILL:
        weak.append(f"The readings hardly determine {told.weakest} (condition number {told.condition:.0f}).")
