"""What a fit holds: noise levels, trajectory, the prior of the hand's motion, and the solution with its rows."""

import dataclasses
import functools
from typing import Any, NamedTuple

import numpy as np

from .._arrays import from_vector, to_vector
from ..fitting import Chain
from ..fitting._chain import Eliminated
from ._model import KINDS, NAMES, DeviceModel, field_of, model_of
from ._normal import LINK, PLACE, PULL, TURN, VELOCITY, Inertial, Rows

SIZES = np.array([KINDS[field_of(name)].prior for name in NAMES])
#: error over prior standard deviation from which a parameter is not determined; if a prior wider by the second factor raises an error by
#: the third, the error depends on the prior
UNSEEN, _LOOSE, _DEPENDS = 0.2, 5.0, 1.2
_DRAWS = 16  # records of white noise that are drawn


def nuisance(name: str) -> bool:
    """Whether a parameter belongs to the motion, or describes a filter: it is not reported with the others."""
    return field_of(name) in ("arm", "accel_pole", "gyro_pole")


@dataclasses.dataclass(frozen=True)
class Noise:
    """Noise levels, one number or one per window (K,): densities of gyroscope and accelerometer, deviation of a magnetometer reading."""

    gyro: Any
    accel: Any
    mag: Any


@dataclasses.dataclass
class Way:
    """Trajectory: attitude (K + 1, 3, 3), velocity, position and acceleration (K + 1, 3) at the ends of the windows, in world axes."""

    rotation: np.ndarray
    velocity: np.ndarray
    place: np.ndarray
    acceleration: np.ndarray

    @property
    def smooth(self) -> np.ndarray:
        """(K + 1, 3, axes) velocity, position and acceleration, which are a Markov process."""
        return np.stack([self.velocity, self.place, self.acceleration], axis=1)

    @property
    def turns(self) -> np.ndarray:
        """(K, 3, 3) rotation of each window."""
        return np.swapaxes(self.rotation[:-1], 1, 2) @ self.rotation[1:]

    def moved(self, step: np.ndarray) -> "Way":
        """The trajectory after a step (K + 1, LINK)."""
        rotation = self.rotation @ from_vector(step[:, TURN])
        return Way(rotation, self.velocity + step[:, VELOCITY], self.place + step[:, PLACE], self.acceleration + step[:, PULL])


@dataclasses.dataclass(frozen=True)
class Rests:
    """Rests: windows (K,), and standard deviations of the velocity (m/s) and of a window's rotation (rad) in them."""

    windows: np.ndarray
    speed: float = 2e-3
    turn: float = 1e-3

    @property
    def ends(self) -> np.ndarray:
        """(K + 1,) ends of windows at rest."""
        return np.concatenate([self.windows, [False]]) | np.concatenate([[False], self.windows])


@dataclasses.dataclass(frozen=True)
class Place:
    """Prior of the hand's position: standard deviations of position (m) and velocity (m/s) along each axis.

    The position is a Matern process of order 5/2, with spectral density in proportion to (a^2 + w^2)^-3 and a^2 = 3 (speed / reach)^2.
    Position, velocity and acceleration together are a Markov process.
    """

    reach: float
    speed: float

    def transition(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transition of (velocity, position, acceleration), and inverse covariances of its process noise and of the first state."""
        a = np.sqrt(3) * self.speed / self.reach
        drift = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-3 * a**2, -(a**3), -3 * a]])
        move = lambda s: np.exp(-a * s) * (np.eye(3) + (near := drift + a * np.eye(3)) * s + near @ near * s**2 / 2)  # noqa: E731
        step = move(time)  # the exponential of drift * time: all three eigenvalues of the drift are -a
        v = self.speed**2
        whole = np.array([[v, 0.0, 0.0], [0.0, self.reach**2, -v], [0.0, -v, self.reach**2 * a**4]])
        # process noise over short times is tiny: computed as an integral it keeps its digits, as a difference it would lose them
        nodes, weights = np.polynomial.legendre.leggauss(12)
        drive = [move(time * (1 - x) / 2)[:, 2] for x in nodes]
        left = 16 / 3 * self.reach**2 * a**5 * time / 2 * sum(
            w * np.outer(d, d) for w, d in zip(weights, drive, strict=True)
        )  # fmt: skip
        return step, np.linalg.inv(left), np.linalg.inv(whole)

    def strained(self, way: Way, time: float, moving: np.ndarray) -> "Place":
        """The same reach, with the speed raised until the process explains the changes between windows: some hands move less smoothly."""
        x, place = way.smooth, self
        for _ in range(12):
            step, known, _ = place.transition(time)
            left = x[1:] - step @ x[:-1]
            if np.sum(left * (known @ left) * moving[:, None, None]) <= 9 * moving.sum():
                break
            place = Place(place.reach, 1.15 * place.speed)
        return place


class Tie(NamedTuple):
    """Rows of a prior, one set for each of the first m links: residuals in standard deviations and their derivatives."""

    residual: np.ndarray  # (m, r)
    here: np.ndarray  # (m, r, LINK) derivative by the link itself
    after: np.ndarray | None = None  # (m, r, LINK) derivative by the next link


def hand_prior(way: Way, place: Place, rests: Rests, time: float) -> list[Tie]:
    """Rows of the prior of the motion: the Markov process of a moving hand, its first state, and at rest velocity and rotation.

    All but the last are linear in the links. Solver, noise levels, errors and derivatives read the prior from these rows.
    """
    step, known, begin = place.transition(time)
    root, first = (np.linalg.cholesky(matrix).T for matrix in (known, begin))
    x, moving = way.smooth, 1.0 - rests.windows[:, None, None]
    left = np.swapaxes(root @ (x[1:] - step @ x[:-1]), 1, 2).reshape(len(moving), 9)
    ties = [
        Tie(left * moving[..., 0], -_by_axis(root @ step) * moving, _by_axis(root) * moving),
        Tie((first @ x[0]).T.reshape(1, 9), _by_axis(first)[None]),
    ]
    if rests.windows.any():
        # within a rest the position is not a Matern process; the acceleration after it starts from its stationary distribution
        weight = np.repeat([1 / rests.speed, place.reach / (3 * place.speed**2)], 3)
        still = weight[:, None] * np.eye(LINK)[np.r_[VELOCITY, PULL]]
        at, back = rests.ends[:, None], way.turns
        ties.append(Tie(np.concatenate([way.velocity, way.acceleration], axis=1) * weight * at, still * at[..., None]))
        turn = np.zeros((2, len(back), 3, LINK))
        turn[0, ..., TURN], turn[1, ..., TURN] = -np.swapaxes(back, 1, 2), np.eye(3)
        scale = rests.windows[:, None] / rests.turn
        ties.append(Tie(to_vector(back) * scale, *(turn * scale[..., None])))
    return ties


def _by_axis(matrix: np.ndarray) -> np.ndarray:
    """(9, LINK) rows that multiply (velocity, position, acceleration) of each axis by a matrix (3, 3)."""
    out = np.zeros((3, 3, LINK))
    for axis in range(3):
        out[axis][:, 3 + axis :: 3] = matrix
    return out.reshape(9, LINK)


def pushed(ties: list[Tie], values: list[np.ndarray], count: int) -> np.ndarray:
    """(count, LINK, ...) transposed derivatives of the rows times values (m, r, ...)."""
    total = np.zeros((count, LINK, *values[0].shape[2:]))
    for tie, value in zip(ties, values, strict=True):
        for first, by in enumerate((tie.here, tie.after)):
            if by is not None:
                total[first : first + len(by)] += np.einsum("kra,kr...->ka...", by, value)
    return total


def with_prior(chain: Chain, ties: list[Tie]) -> Chain:
    """Normal equations with those of the prior added."""
    links, between = chain.links.copy(), chain.ties.copy()
    for here, after in ((tie.here, tie.after) for tie in ties):
        links[: len(here)] += np.swapaxes(here, 1, 2) @ here
        if after is not None:
            links[1:] += np.swapaxes(after, 1, 2) @ after
            between += np.swapaxes(here, 1, 2) @ after
    score = chain.link_score + pushed(ties, [tie.residual for tie in ties], len(links))
    return dataclasses.replace(chain, links=links, ties=between, link_score=score)


@dataclasses.dataclass
class Point:
    """Parameters and trajectory, with the rows there."""

    vector: np.ndarray
    way: Way
    back: int  # see `Record.back`
    moved: Inertial
    rows: Rows
    prior: list[Tie]
    cost: float  # half the sum of squares

    @property
    def model(self) -> DeviceModel:
        return model_of(self.vector)


@dataclasses.dataclass
class Solution(Point):
    """The end of a fit, with its normal equations."""

    chain: Chain
    eliminated: Eliminated
    converged: bool
    free: np.ndarray
    counts: np.ndarray  # (K,) weights of the field residuals of each window
    kept: np.ndarray  # (K, m) whether a reading of the magnetometer is used
    noise: Noise
    rests: Rests

    @property
    def weight(self) -> np.ndarray:
        """(K, m) weight of each reading of the magnetometer, over its standard deviation."""
        return self.counts[:, None] * self.kept / np.reshape(self.noise.mag, (-1, 1))

    @property
    def field(self) -> np.ndarray:
        """(K, m, 3) field residuals in standard deviations, without the weights; zero where there is no reading."""
        return self.rows.field / self.counts[:, None, None]

    @property
    def field_power(self) -> np.ndarray:
        """(K,) mean square of the field residuals in each window."""
        number = np.maximum(self.kept.sum(axis=1), 1)
        return np.sum(np.where(self.kept[..., None], self.field, 0.0) ** 2, axis=(1, 2)) / (3 * number)

    @property
    def unseen(self) -> np.ndarray:
        """(p,) whether a free parameter is not determined: its error is near to that of the prior, or depends on the prior."""
        sizes = SIZES[self.free]
        scaled = self.eliminated.information * np.outer(sizes, sizes)
        error, loose = (np.sqrt(np.diag(np.linalg.inv(scaled - share * np.eye(len(sizes))))) for share in (0.0, 1 - _LOOSE**-2))
        asked = np.array([not nuisance(NAMES[i]) for i in self.free])
        return asked & ((error >= UNSEEN) | ~(loose <= _DEPENDS * error))

    @functools.cached_property
    def residuals(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Sensor -> residuals (K, 3) of the windows, and those of fits to simulated white noise (K, 3, draws); sums of those of the field.

        Near its solution the fit is linear. So white noise is drawn for every row, and the normal equations are solved for it. This shows
        how much of the noise the unknowns absorb.
        """
        rng = np.random.default_rng(0)
        free, rows, size = self.free, self.rows, len(NAMES)
        count, width = len(rows.inertial), len(self.free)
        draw = lambda *shape: rng.normal(size=(*shape, _DRAWS))  # noqa: E731
        own = rows.inertial_by[:, :, np.append(free, np.arange(size, size + 18))]
        noise = draw(count, 9)
        push = np.swapaxes(own, 1, 2) @ noise
        ends = np.zeros((count + 1, LINK, _DRAWS))
        ends[:-1, :9] += push[:, width : width + 9]
        ends[1:, :9] += push[:, width + 9 :]
        score = push[:, :width].sum(axis=0)
        field_by = rows.field_by[..., np.append(free, np.arange(size, size + 3))].reshape(count, -1, width + 3)
        seen = draw(count, field_by.shape[1]) * np.repeat(self.kept, 3, axis=1)[..., None]
        push = np.swapaxes(field_by, 1, 2) @ seen
        ends[:-1, :3] += push[:, width:]
        score += push[:, :width].sum(axis=0)
        ends += pushed(self.prior, [draw(*tie.residual.shape) for tie in self.prior], count + 1)
        score += draw(width) / SIZES[free][:, None]
        links, steps = self.chain.steps(ends, score)
        steps_all = np.broadcast_to(steps, (count, *steps.shape))
        left = noise + own @ np.concatenate([steps_all, links[:-1, :9], links[1:, :9]], axis=1)
        field = (seen + field_by @ np.concatenate([steps_all, links[:-1, :3]], axis=1)).reshape(count, -1, 3, _DRAWS).sum(axis=1)
        inertial = rows.inertial
        return {"gyro": (inertial[:, :3], left[:, :3]), "accel": (inertial[:, 3:6], left[:, 3:6]), "mag": (rows.field.sum(axis=1), field)}

    def hand(self, time: float, level: Noise) -> tuple[Place, Rests]:
        """Reach and speed of the hand in motion: mean squares of the estimates, plus their variances. Speed and turn at rest.

        The variance of the velocity at rest is the mean square of the estimates, divided by the part of the variance that the readings show
        (D. MacKay, Neural Computation 4, 1992, 415).
        """
        spread = self.chain.variances(np.linalg.inv(self.eliminated.information), self.eliminated.carried)
        spread = np.diagonal(spread, axis1=1, axis2=2)
        ends, way = self.rests.ends, self.way
        moving = ~ends
        reach = np.mean(way.place[moving] ** 2 + spread[moving, PLACE])
        speed = np.mean(way.velocity[moving] ** 2 + spread[moving, VELOCITY])
        place = Place(float(np.sqrt(reach)), float(np.sqrt(speed))).strained(way, time, 1.0 - self.rests.windows)
        if not ends.any():
            return place, self.rests
        # on a table the true velocity is zero. The mean square plus the variance of the estimate would need many rounds to come near it
        shown = 1 - np.mean(spread[ends, VELOCITY]) / self.rests.speed**2
        slow = np.mean(way.velocity[ends] ** 2) / max(shown, UNSEEN)
        turned = np.mean(to_vector(way.turns[self.rests.windows]) ** 2)
        least = 0.2 * np.min(level.gyro) * np.sqrt(time)
        return place, Rests(self.rests.windows, float(np.sqrt(slow)), max(float(np.sqrt(turned)), float(least)))
