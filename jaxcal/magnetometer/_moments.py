"""`Moments`: the calibration that a microcontroller makes from 35 sums, in double precision; the C code is `export/_embedded/sensors.c`."""

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._types import Samples
from ._field import INCLINATION
from ._model import MagModel
from ._quadric import EXPONENTS, NEAR_PLANAR, NotEllipsoid, adjusted, constrained, ellipsoid_of, noisy, soft_of

#: exponents (a, b, c) of the moments x^a y^b z^c, in the order of the sums; place of the moments among them
_POWERS = np.array([(a, b, c) for a in range(5) for b in range(5 - a) for c in range(5 - a - b)])
_PLACE = {tuple(power): k for k, power in enumerate(_POWERS.tolist())}
#: moment of the product of each two monomials of a quadric
_PRODUCT = np.array([[_PLACE[tuple(power)] for power in row] for row in (EXPONENTS[:, None] + EXPONENTS).tolist()])
#: least number of readings; most in one of 24 directions, above which a device that lies still would decide; when the frame is renewed
_LEAST, _MOST, _RENEWED = 12, 2000, (16, 64, 256)
#: rms heading error, doubled for 95 %, up to which the verdict is "good"; five times it is refused. Noise over field above which it is weak
_LIMIT, _NOISY = np.deg2rad(1.0), 0.1


class Moments:
    r"""Collect readings of a magnetometer in 35 sums, and fit hard and soft iron from these alone, as the exported C code does.

    The sums are :math:`\sum x^a y^b z^c`, :math:`a + b + c \le 4`, of :math:`u = (m - c) / s`. They give the mean products of the monomials
    of a quadric, and with them the adjusted least squares fit, which has no bias from noise, and the fit of the magnetometer paper.

    Parameters
    ----------
    sums : (35,) moments that a device sent home, a slowest and c fastest; by default none.
    centre, scale : c (3,) and s of these moments, in the unit of the readings.

    Attributes
    ----------
    count, held, outliers : readings admitted, repeated, and left out as far from the running fit.
    model : the `MagModel`, with a soft iron of determinant 1; None if there is none.
    field, noise : mean size of the corrected readings, and standard deviation of one axis, in their unit.
    heading_error : to expect at level, root mean square over all headings, in rad.
    verdict : "good" (twice the error is at most 1 degree), "weak", or "refused" (the error is above 5 degrees).
    reasons : of "few", "no_ellipsoid", "uncertain", "noisy".

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, scenario
    >>> m = body_field(scenario("all"), 47.0) + [10.0, -5.0, 20.0] + np.random.default_rng(0).normal(0.0, 0.1, (360, 3))
    >>> moments = jaxcal.magnetometer.Moments()
    >>> moments.add(m), moments.solve(), moments.model.hard_iron.round(1)
    (360, 'good', array([10., -5., 20.]))

    References
    ----------
    I. Markovsky, A. Kukush and S. Van Huffel, Numer. Math. 98 (2004) 177. The magnetometer paper, equations 11 to 16.
    """

    def __init__(self, sums: Samples | None = None, centre: Samples = (0.0, 0.0, 0.0), scale: float = 1.0) -> None:
        self.sums: np.ndarray = np.zeros(len(_POWERS))
        self.centre: np.ndarray = np.array(centre, dtype=float)
        self.scale: float = float(scale)
        if sums is not None:
            self.sums = np.array(sums, dtype=float)
            if self.sums.shape != (len(_POWERS),) or not np.all(np.isfinite(self.sums)) or self.centre.shape != (3,) or not scale > 0:
                raise DataError("expected 35 finite sums, a centre of three numbers and a scale above zero", code="bad_moments")
        self.count: int = int(self.sums[0])
        self.held: int = 0
        self.outliers: int = 0
        self._last, self._bins = np.full(3, np.nan), np.zeros(24, dtype=int)
        self.model: MagModel | None = None
        self.field: float = float("inf")
        self.noise: float = float("inf")
        self.heading_error: float = float("inf")
        self.verdict: str = "refused"
        self.reasons: tuple[str, ...] = ("few",)

    def add(self, m: Samples) -> int:
        """Admit readings (n, 3), or one of (3,), and return how many. Those that repeat or lie far from the running fit are left out."""
        return sum(map(self._admitted, np.asarray(m, dtype=float).reshape(-1, 3)))

    def _admitted(self, m: np.ndarray) -> bool:
        if not np.all(np.isfinite(m)):
            return False
        if self.count == 0:
            self.centre, self.scale = m.copy(), float(np.abs(m).sum()) or 1.0
        elif np.array_equal(m, self._last):
            self.held += 1
            return False
        self._last = m.copy()
        u = (m - self.centre) / self.scale
        if self.model is not None:
            far = abs(float(np.linalg.norm(np.linalg.solve(self.model.soft_iron, m - self.model.hard_iron))) - self.field)
            if not far <= 6 * self.noise + self.field / 20:
                self.outliers += 1
                return False
        axis = int(np.argmax(np.abs(u)))
        way = 8 * axis + int(np.roll(u > 0, -axis) @ [4, 2, 1])
        if not np.abs(u).sum() < 100 or self._bins[way] >= _MOST:
            return False
        self._bins[way] += 1
        self.count += 1
        self.sums += np.prod(u**_POWERS, axis=1)
        since = self.count - max((at for at in _RENEWED if at <= self.count), default=self.count + 1)
        if 0 <= since < 4:  # four readings share the work, as on the device
            self._renew(since)
        return True

    def _renew(self, step: int) -> None:
        """Move the frame to the mean of the readings along an axis (step 0 to 2), or scale it to a root mean square of 1 (3)."""
        if step == 3:
            size = float(np.sqrt(max(np.trace(self._products()[6:9, 6:9]), 0.0)))
            if size > 0:
                self.sums, self.scale = self.sums / size ** _POWERS.sum(axis=1), self.scale * size
            return
        mean = self.sums[_PLACE[tuple(np.eye(3, dtype=int)[step].tolist())]] / self.sums[0]
        others = (np.delete(_POWERS, step, axis=1)[:, None] == np.delete(_POWERS, step, axis=1)).all(axis=2)
        high, low = _POWERS[:, None, step], _POWERS[:, step]
        binomial = scipy.special.comb(high, low) * (-mean) ** np.maximum(high - low, 0)
        moves = np.where(others & (high >= low), binomial, 0.0)
        self.sums = moves @ self.sums
        self.centre[step] += self.scale * mean

    def _products(self) -> np.ndarray:
        return self.sums[_PRODUCT] / max(self.sums[0], 1.0)

    def solve(self, method: str = "consistent", *, inclination: float = INCLINATION) -> str:
        """Fit the readings so far and return the verdict.

        Parameters
        ----------
        method : "consistent" (adjusted least squares) or "constrained" (4AC - B^2 = 1, the magnetometer paper).
        inclination : dip of the field in rad.
        """
        if method not in ("consistent", "constrained"):
            raise DataError(f"method {method!r}: expected 'consistent' or 'constrained'", code="bad_method")
        self.model, self.verdict, self.heading_error = None, "refused", np.inf
        if self.count < _LEAST:
            self.reasons = ("few",)
            return self.verdict
        for step in range(4):
            self._renew(step)
        products, self.reasons = self._products(), ("no_ellipsoid",)
        if not np.linalg.eigvalsh(products[6:9, 6:9])[0] > NEAR_PLANAR**2:
            return self.verdict
        q = constrained(products) if method == "constrained" else None
        s2, q = adjusted(products) if q is None else (_variance(products, q), q)
        try:
            shape, centre = ellipsoid_of(q)
        except NotEllipsoid:
            return self.verdict
        soft = soft_of(shape)
        radius = float(np.cbrt(np.linalg.det(soft)))
        self.field, self.noise = radius * self.scale, float(np.sqrt(s2)) * self.scale
        self.model = MagModel(soft / radius, self.centre + self.scale * centre)
        spread = noisy(products, s2) + np.outer(q, q)  # the length of q is free
        slopes = _heading_slopes(q, inclination)
        with np.errstate(all="ignore"):
            square = np.mean(np.sum(slopes * np.linalg.solve(spread, slopes.T).T, axis=1)) * (q @ products @ q) / (self.count - 9)
        self.heading_error = float(np.sqrt(square)) if square >= 0 else np.inf
        doubts = {"uncertain": not 2 * self.heading_error <= _LIMIT, "noisy": not s2 <= (_NOISY * radius) ** 2}
        self.reasons = tuple(name for name, doubtful in doubts.items() if doubtful)
        self.verdict = "refused" if not self.heading_error <= 5 * _LIMIT else "weak" if self.reasons else "good"
        return self.verdict


def _variance(products: np.ndarray, q: np.ndarray) -> float:
    """Variance of the noise: the mean square of the residuals over its slope in the variance."""
    square, step = q @ products @ q, 2.0**-10
    return float(abs(square * step / (square - q @ noisy(products, step) @ q)))


def _heading_slopes(q: np.ndarray, inclination: float) -> np.ndarray:
    """Derivatives (8, 10) of eight headings at level by the quadric, from central differences."""
    psi, step = np.arange(8) * np.pi / 4, 1e-4
    h = np.stack([np.cos(inclination) * np.cos(psi), -np.cos(inclination) * np.sin(psi), np.full(8, np.sin(inclination))], axis=1)
    shape, centre = ellipsoid_of(q)
    u = h @ soft_of(shape) + centre

    def turned(changed: np.ndarray) -> np.ndarray:
        shape, centre = ellipsoid_of(changed)
        x = np.linalg.solve(soft_of(shape), (u - centre).T)
        return -(np.sin(psi) * x[0] + np.cos(psi) * x[1]) / np.cos(inclination)

    try:
        return np.stack([(turned(q + one) - turned(q - one)) / (2 * step) for one in step * np.eye(len(q))], axis=1)
    except NotEllipsoid:
        return np.full((8, len(q)), np.inf)
