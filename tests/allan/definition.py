"""Deviations by their definition in extended precision, against which every way of computing them is checked."""

import numpy as np


def differences(y, m, name, data="rate", stride=None):
    """Differences that no gap touches, the number of all differences, and the factor from the mean square to the variance at a rate of 1.

    They are those of the phase, or of its running sum (mdev, tdev), at every start, every m-th (adev, hdev) or every `stride`-th.
    """
    order, modified = 3 if name.endswith("hdev") else 2, name in ("mdev", "tdev")
    y = np.asarray(y, dtype=np.longdouble)
    lost = np.isnan(y)
    theta = y if data == "phase" else np.concatenate([[0], np.cumsum(np.where(lost, 0, y - np.mean(y[~lost] if not lost.all() else 0.0)))])
    reach = order * m if data == "rate" else None  # samples of one difference
    if modified:
        theta, reach = np.concatenate([[0], np.cumsum(np.nan_to_num(theta))]), 3 * m - (data == "rate")
    for _ in range(3 if modified else order):
        theta = theta[m:] - theta[:-m]
    gone = np.concatenate([[0], np.cumsum(lost)])
    kept = np.isfinite(theta) if reach is None else gone[reach : reach + len(theta)] == gone[: len(theta)]
    starts = slice(None, None, stride or (m if name in ("adev", "hdev") else 1))
    scale = 1.0 / ((2.0 if order == 2 else 6.0) * m**2 * (m**2 if modified else 1.0)) * (m**2 / 3.0 if name == "tdev" else 1.0)
    return theta[starts][kept[starts]], len(theta[starts]), scale


def truth(y, sizes, name, data="rate"):
    """Deviation for a rate of 1; NaN where a gap touches every difference."""
    found = []
    for m in (int(size) for size in sizes):
        d, _, scale = differences(y, m, name, data)
        found.append(float(np.sqrt(d @ d / len(d) * scale)) if len(d) else np.nan)
    return np.array(found)


def records(length, seed):
    """White noise, its running sum, and the running sum of this sum."""
    white = np.random.default_rng(seed).standard_normal(length)
    return {"white": white, "walk": np.cumsum(white), "integrated walk": np.cumsum(np.cumsum(white))}
