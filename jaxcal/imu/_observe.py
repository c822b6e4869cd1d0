"""What still poses tell about an accelerometer, and which attitudes are missing (host, NumPy)."""

import itertools

import equinox as eqx
import numpy as np

from .._types import AnyArray

_WORDS = (
    "scale along x", "scale along y", "scale along z", "misalignment of x and y", "misalignment of x and z", "misalignment of y and z",
    "bias along x", "bias along y", "bias along z",
)  # fmt: skip
DIAGONAL = [0, 1, 2, 6, 7, 8]
#: condition numbers of the natural information: 18 even poses have 3 to 4; from here on poses are missing, or nothing is known
_ENOUGH, ILL, SINGULAR = 12.0, 60.0, 300.0
_NEAR = np.cos(np.deg2rad(25.0))
_ALIKE = 20.0  # degrees
_PLACES = np.array([p for p in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(p)])
_UNITS = _PLACES / np.linalg.norm(_PLACES, axis=1, keepdims=True)


class Observability(eqx.Module):
    """How well the attitudes of the still poses determine the accelerometer.

    Attributes
    ----------
    condition : ratio of the largest to the smallest singular value for errors of natural size.
    missing : (m, 3) directions that should point up in further poses, in body axes, the most useful first.
    sentence : what the poses determine, and which are missing.
    """

    condition: float
    missing: AnyArray
    sentence: str = eqx.field(static=True)


def rows(up: np.ndarray) -> np.ndarray:
    """Change of |f|/g for a change E of the correction and c of the bias: u'Eu + u'c, E symmetric."""
    x, y, z = up.T
    return np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z], axis=1)


def spread(information: np.ndarray) -> tuple[float, np.ndarray]:
    """Condition number of the residuals' Jacobian, and how much each parameter shares in what it determines least."""
    values, vectors = np.linalg.eigh(information)
    least = max(float(values[0]), 0.0)
    weak = values <= max(values[-1] / SINGULAR**2, 1.5 * least)
    condition = float(np.sqrt(values[-1] / least)) if least > 1e-12 * values[-1] else np.inf
    return condition, np.sqrt(np.sum(vectors[:, weak] ** 2, axis=1))


def name(direction: np.ndarray) -> str:
    """A direction in words: the nearest face, edge or corner of the case."""
    place = _PLACES[np.argmax(_UNITS @ direction)]
    axes = [f"{'+' if sign > 0 else '-'}{axis}" for sign, axis in zip(place, "xyz", strict=True) if sign]
    return " and ".join([", ".join(axes[:-1]), axes[-1]] if len(axes) > 1 else axes) + " up"


def observability(up: np.ndarray, diagonal: bool = False) -> Observability:
    """How well the attitudes of still poses determine an accelerometer, before or after they are recorded.

    Parameters
    ----------
    up : (k, 3) unit vectors, the upward direction in body axes of each pose.
    diagonal : leave misalignment out: three scales and three biases.

    Returns
    -------
    Observability
        Condition number, the directions that are missing, and a sentence.

    Examples
    --------
    The six faces show scale and bias, but no misalignment:

    >>> import numpy as np
    >>> import jaxcal
    >>> faces = np.concatenate([np.eye(3), -np.eye(3)])
    >>> jaxcal.imu.observability(faces).condition
    inf
    >>> jaxcal.imu.observability(faces, diagonal=True).sentence[:33]
    'The 6 poses determine every param'

    References
    ----------
    The singular values of the norm residuals' derivative, D. Tedaldi, A. Pretto and E. Menegatti, ICRA 2014, equation (10), for errors
    of equal size.
    """
    chosen = DIAGONAL if diagonal else list(range(9))
    told = rows(up)[:, chosen]
    information = told.T @ told / len(up)
    condition, share = spread(information)
    words = ", ".join(_WORDS[chosen[i]] for i in range(len(chosen)) if share[i] > 0.5 * share.max())
    if condition <= _ENOUGH:
        return Observability(condition, np.zeros((0, 3)), f"The {len(up)} poses determine every parameter; least certain: {words}.")
    extra = rows(_UNITS)[:, chosen] / len(up)
    free = np.all(_UNITS @ up.T < _NEAR, axis=1)
    picked: list[np.ndarray] = []
    grown = information + 1e-6 * np.eye(len(chosen))
    while free.any() and len(picked) < 9 and spread(grown)[0] > _ENOUGH / 2:
        # the pose that takes most off the variance, as if it were held three times
        gain = np.array([np.linalg.slogdet(grown + 3 * len(up) * np.outer(row, row))[1] for row in extra])
        best = int(np.argmax(np.where(free, gain, -np.inf)))
        picked.append(_UNITS[best])
        grown = grown + 3 * len(up) * np.outer(extra[best], extra[best])
        free &= _UNITS @ _UNITS[best] < _NEAR
    middle = up.mean(axis=0)
    apart = np.rad2deg(np.arccos(np.clip(np.min(up @ middle) / max(np.linalg.norm(middle), 1e-12), -1, 1)))
    if apart < _ALIKE:
        words = f"the accelerometer: they are all alike, within {max(apart, 1):.0f} degrees of one attitude"
    degree = "do not determine" if condition > SINGULAR else "hardly determine" if condition > ILL else "leave uncertain"
    advice = "; ".join(name(direction) for direction in picked)
    sentence = f"The {len(up)} poses {degree} {words} (condition number {condition:.3g})."
    return Observability(condition, np.array(picked).reshape(-1, 3), sentence + (f" Add poses with {advice}." if picked else ""))
