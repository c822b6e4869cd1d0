"""`observability`: how well still poses determine an accelerometer, and which poses are missing."""

import itertools

import equinox as eqx
import numpy as np

from .._answer import Finding, Quantity
from .._types import AnyArray
from ._findings import FINDINGS

#: directions of the 26 faces, edges and corners of a case
PLACES = np.array([np.array(p) / np.linalg.norm(p) for p in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(p)])
_WORDS = (
    "scale along x", "scale along y", "scale along z", "misalignment of x and y", "misalignment of x and z", "misalignment of y and z",
    "bias along x", "bias along y", "bias along z",
)  # fmt: skip
#: limits of the condition number: above them poses are missing, and the fit is singular
_ENOUGH, SINGULAR = FINDINGS["attitudes"].limits
#: cosine of half of the angle between a face and the nearest edge, with some margin: closer attitudes count as the same; spread of the
#: poses, rad, below which they are one attitude, which not even turns determine
NEAR, ONE_ATTITUDE = float(np.cos(np.deg2rad(25.0))), np.deg2rad(5.0)


class Observability(eqx.Module):
    """How well the attitudes of the still poses determine the accelerometer.

    Attributes
    ----------
    poses : number of poses.
    condition : ratio of the largest to the smallest singular value of the Jacobian, for parameter errors of equal size.
    weakest : the parameters that the poses determine least.
    missing : (m, 3) directions in body axes that should point up in further poses, the most useful first.
    spread : largest angle between a pose's vertical and the mean of all, rad.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> found = jaxcal.imu.observability(np.concatenate([np.eye(3), -np.eye(3)]))
    >>> found.condition, found.sentence[:52]
    (inf, 'The 6 poses do not determine misalignment of x and y')
    """

    poses: int
    condition: float
    weakest: tuple[str, ...] = eqx.field(static=True)
    missing: AnyArray
    spread: float

    @property
    def determined(self) -> bool:
        """Whether the poses alone determine the accelerometer."""
        return self.condition <= SINGULAR

    @property
    def finding(self) -> Finding:
        """What the poses determine; fatal if they do not determine every parameter."""
        what, missing = ", ".join(self.weakest), "; ".join(map(_name, self.missing)) or "other attitudes"
        if self.condition > _ENOUGH and self.spread < ONE_ATTITUDE:
            return FINDINGS("attitudes_alike", poses=self.poses, spread=Quantity(max(self.spread, np.deg2rad(1)), "angle"), missing=missing)
        facts = {"poses": self.poses, "what": what, "condition": self.condition, "missing": missing}
        facts["degree"] = "hardly determine" if self.determined else "do not determine"
        told = FINDINGS.over("attitudes", self.condition, **facts)
        return told[0] if told else FINDINGS("attitudes_enough", poses=self.poses, what=what)

    @property
    def sentence(self) -> str:
        """The finding as a sentence."""
        return str(self.finding)


def _rows_of(up: np.ndarray) -> np.ndarray:
    """Derivative of |f|/g with respect to a symmetric change E of the correction and a change c of the bias: u'Eu + u'c."""
    x, y, z = up.T
    return np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z], axis=1)


def _condition(information: np.ndarray) -> tuple[float, np.ndarray]:
    """Condition number of the Jacobian, and the share of each parameter in the least determined directions."""
    values, vectors = np.linalg.eigh(information)
    least = max(float(values[0]), 0.0)
    weak = values <= max(values[-1] / SINGULAR**2, 1.5 * least)
    condition = float(np.sqrt(values[-1] / least)) if least > 1e-12 * values[-1] else np.inf
    return condition, np.sqrt(np.sum(vectors[:, weak] ** 2, axis=1))


def _name(direction: np.ndarray) -> str:
    """Name a direction by the nearest face, edge or corner of the case."""
    place = PLACES[np.argmax(PLACES @ direction)]
    axes = [f"{'+' if sign > 0 else '-'}{axis}" for sign, axis in zip(place, "xyz", strict=True) if sign]
    return " and ".join([", ".join(axes[:-1]), axes[-1]] if len(axes) > 1 else axes) + " up"


def observability(up: np.ndarray, diagonal: bool = False) -> Observability:
    """Check how well the attitudes of still poses determine an accelerometer, before or after you record them.

    Parameters
    ----------
    up : (k, 3) unit vectors, the upward direction in body axes of each pose.
    diagonal : True for a model without misalignment: three scales and three biases.

    Returns
    -------
    Observability
        Condition number, missing directions, and a sentence.

    Examples
    --------
    The six faces determine scale and bias, but not misalignment:

    >>> import numpy as np
    >>> import jaxcal
    >>> faces = np.concatenate([np.eye(3), -np.eye(3)])
    >>> jaxcal.imu.observability(faces).condition
    inf
    >>> jaxcal.imu.observability(faces, diagonal=True).sentence[:33]
    'The 6 poses determine every param'

    References
    ----------
    The singular values of the Jacobian of the magnitude residuals of D. Tedaldi, A. Pretto and E. Menegatti, ICRA 2014, equation (10),
    for parameter errors of equal size.
    """
    chosen = [i for i, word in enumerate(_WORDS) if not (diagonal and word.startswith("misalignment"))]
    told = _rows_of(up)[:, chosen]
    information = told.T @ told / len(up)
    condition, share = _condition(information)
    weakest = tuple(_WORDS[chosen[i]] for i in range(len(chosen)) if share[i] > 0.5 * share.max())
    picked: list[np.ndarray] = []
    if condition > _ENOUGH:
        extra = _rows_of(PLACES)[:, chosen] / len(up)
        free = np.all(PLACES @ up.T < NEAR, axis=1)
        grown = information + 1e-6 * np.eye(len(chosen))
        while free.any() and len(picked) < 9 and _condition(grown)[0] > _ENOUGH / 2:
            # choose the pose that increases the information most; it counts as if it were held three times
            gain = np.array([np.linalg.slogdet(grown + 3 * len(up) * np.outer(row, row))[1] for row in extra])
            best = int(np.argmax(np.where(free, gain, -np.inf)))
            picked.append(PLACES[best])
            grown = grown + 3 * len(up) * np.outer(extra[best], extra[best])
            free &= PLACES @ PLACES[best] < NEAR
    middle = up.mean(axis=0)
    spread = float(np.arccos(np.clip(np.min(up @ middle) / max(np.linalg.norm(middle), 1e-12), -1, 1)))
    return Observability(len(up), condition, weakest, np.array(picked).reshape(-1, 3), spread)
