"""Good, weak or refused, and why."""

import equinox as eqx
import numpy as np

from ._orthogonal import Found
from ._quadric import NotEllipsoid, ellipsoid_of, nearest_quadric, sampson

NEAR_PLANAR = 0.05  # smallest singular value of the centred readings, of 0.58 for a full sphere
_OUTLIER = 4.0
_MANY_OUTLIERS = 0.01
_NOISY, _TOO_NOISY = 0.1, 0.2
_ILL = 1000.0


class Judgement(eqx.Module):
    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)


def third_extent(u: np.ndarray) -> float:
    """Root mean square of the readings along their thinnest direction, in units of that about their mean."""
    return float(np.linalg.svd(u - u.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(u)))


def outliers(found: Found) -> np.ndarray:
    """Readings off by four robust standard deviations, or with less than half their weight."""
    size = np.abs(found.distance)
    spread = 1.4826 * np.median(size)
    return np.flatnonzero((size > max(_OUTLIER * spread, 1e-9)) | (found.weight < 0.33))


def other_quadric(found: Found, u: np.ndarray) -> str | None:
    """Why the readings lie on another quadric than an ellipsoid, if they lie on it twice as close."""
    kept = u[found.weight > 0.5]
    theta = nearest_quadric(kept)
    try:
        ellipsoid_of(theta)
    except NotEllipsoid as error:
        far = np.sqrt(np.mean(found.distance[found.weight > 0.5] ** 2))
        if far > 1e-6 and 2 * np.sqrt(np.mean(sampson(theta, kept) ** 2)) < far:
            return str(error)
    return None


def judge(found: Found, u: np.ndarray, error: np.ndarray, condition: float, weakest: str, limits, loss, planar: str | None) -> Judgement:
    """Verdict with the sentences that lead to it, the gravest first."""
    refused, weak = [], []
    radius = np.linalg.det(found.shape) ** (-1 / 6)
    relative = found.noise / radius
    level, tilted = np.rad2deg(error)
    far = outliers(found)
    if not found.converged:
        refused.append(f"The fit did not converge: {found.message or 'it diverged, as fits of this cost do with partial coverage'}")
    if planar is None and (other := other_quadric(found, u)):
        refused.append(f"The readings lie on no ellipsoid: {other}.")
    if planar is None and third_extent(u) < NEAR_PLANAR:
        refused.append(
            "The readings are near-planar: they leave the field across their plane open. Turn about a second axis, or use model='planar'."
        )
    if not np.isfinite(condition) or condition > 1e8:
        refused.append(f"The readings do not determine {weakest}.")
    if relative > _TOO_NOISY:
        refused.append(f"The readings scatter by {100 * relative:.0f} % of the field about the best ellipsoid; they do not lie on one.")
    elif relative > _NOISY:
        weak.append(f"The readings scatter by {100 * relative:.0f} % of the field about the ellipsoid.")
    if not level <= np.rad2deg(limits[0]):
        text = f"The heading would be wrong by {level:.2g} degrees rms" + (
            "" if planar else f" at level and {tilted:.2g} at 20 degrees of tilt"
        )
        (refused if not level <= np.rad2deg(limits[1]) else weak).append(f"{text}; least certain is {weakest}.")
    if np.isfinite(condition) and 1e8 >= condition > _ILL:
        weak.append(f"The readings hardly determine {weakest} (condition number {condition:.0f}).")
    if loss is None and len(far) > max(_MANY_OUTLIERS * len(u), 2):
        weak.append(f"{len(far)} of {len(u)} readings are outliers; use loss='huber' or 'tukey', or leave them out.")
    if len(far) > 0.4 * len(u):
        refused.append(f"{len(far)} of {len(u)} readings are outliers: no majority of the readings agrees.")
    if planar == "chosen":
        weak.append("The readings are near-planar, and were fitted in their plane.")
    note = "It holds for headings in the plane of the readings only." if planar else ""
    if refused or weak:
        return Judgement("refused" if refused else "weak", " ".join([*refused, *weak, *([note] if note else [])]))
    extent = (
        f"{level:.2g} degrees rms in the plane" if planar else f"{level:.2g} degrees rms at level and {tilted:.2g} at 20 degrees of tilt"
    )
    return Judgement(
        "good", f"The heading error to expect is {extent}, a rotation common to all readings apart." + (f" {note}" if note else "")
    )
