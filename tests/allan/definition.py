"""Deviations of plain slices in extended precision, against which all ways of computing them are checked."""

import numpy as np


def differences(y, m, name):
    """Differences of the phase or of its running sum in extended precision, and the factor from their mean square to the variance."""
    order, modified = 3 if name.endswith("hdev") else 2, name in ("mdev", "tdev")
    y = y.astype(np.longdouble)
    d = np.concatenate([[np.longdouble(0)], np.cumsum(y - y.mean())])
    if modified:
        d = np.concatenate([[np.longdouble(0)], np.cumsum(d)])
    for _ in range(3 if modified else order):
        d = d[m:] - d[:-m]
    scale = 1.0 / ((2.0 if order == 2 else 6.0) * m**2 * (m**2 if modified else 1.0)) * (m**2 / 3.0 if name == "tdev" else 1.0)
    return d[::m] if name in ("adev", "hdev") else d, scale


def truth(y, sizes, name):
    """Deviation for a rate of 1."""
    found = []
    for m in (int(size) for size in sizes):
        d, scale = differences(y, m, name)
        found.append(float(np.sqrt(d @ d / len(d) * scale)))
    return np.array(found)
