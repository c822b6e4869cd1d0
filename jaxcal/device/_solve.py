"""The estimator: Gauss-Newton steps for the parameters and the trajectory of the device (host)."""

import dataclasses
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._precision import array_module
from ..fitting import Chain, Eliminated
from ._model import DeviceModel
from ._normal import GYRO_DELAY, LINK, MAG_DELAY, Inertial, Rows, chain_of, exponential, inertial, logarithm, rows
from ._windows import NAMES, Grid, Windows, model_of, steps_back, windows

#: largest delay, s
REACH = 0.05
_NEAR = 0.75  # steps by which a delay may leave its sampling interval before the interval is changed
STEPS = 25  # of a fit, at most
_SETTLED = 1e-4  # the fit has converged when a step is expected to lower the cost (half the sum of squares) by less
_SLOW, _FURTHEST = 0.5, 30.0  # ratio of successive steps above which a step is lengthened; largest factor
#: prior standard deviation of each kind of parameter, far wider than the errors after a recording
_SIZES = {
    "accel.matrix": 0.1, "accel.bias": 1.0, "accel.g_sensitivity": 1.0, "gyro.matrix": 0.1, "gyro.bias": 0.1, "gyro.g_sensitivity": 1e-3,
    "magnetometer.soft_iron": 0.5, "magnetometer.hard_iron": 2.0, "field": 1.0, "dip": 1.0, "gyro_delay": 0.03, "mag_delay": 0.03,
    "lever": 0.1, "arm": 0.3,
}  # fmt: skip
SIZES = np.array([_SIZES[name.partition("[")[0]] for name in NAMES])


@dataclasses.dataclass(frozen=True)
class Noise:
    """Noise levels, one number or one per window (K,): densities of gyroscope and accelerometer, deviation of a magnetometer reading."""

    gyro: Any
    accel: Any
    mag: Any


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
        step = scipy.linalg.expm(drift * time)
        v = self.speed**2
        whole = np.array([[v, 0.0, 0.0], [0.0, self.reach**2, -v], [0.0, -v, self.reach**2 * a**4]])
        # process noise over short times is tiny: computed as an integral it keeps its digits, as a difference it would lose them
        nodes, weights = np.polynomial.legendre.leggauss(12)
        drive = [scipy.linalg.expm(drift * time * (1 - x) / 2)[:, 2] for x in nodes]
        left = 16 / 3 * self.reach**2 * a**5 * time / 2 * sum(
            w * np.outer(d, d) for w, d in zip(weights, drive, strict=True)
        )  # fmt: skip
        return step, np.linalg.inv(left), np.linalg.inv(whole)

    def strained(self, way: Any, time: float, moving: np.ndarray) -> "Place":
        """The same reach, with the speed raised until the process explains the changes between windows: some hands move less smoothly."""
        x, place = np.stack([way.velocity, way.place, way.acceleration], axis=1), self
        for _ in range(12):
            step, known, _ = place.transition(time)
            left = x[1:] - step @ x[:-1]
            if np.sum(left * (known @ left) * moving[:, None, None]) <= 9 * moving.sum():
                break
            place = Place(place.reach, 1.15 * place.speed)
        return place

    def rows(self, way: Any, time: float, moving: np.ndarray) -> tuple[float, Chain]:
        """Half the sum of squares, and its part of the normal equations, of the windows in which the device is `moving`."""
        step, known, first = self.transition(time)
        x = np.stack([way.velocity, way.place, way.acceleration], axis=1)  # (K + 1, 3, axes)
        left = x[1:] - step @ x[:-1]
        inner = known @ left * moving[:, None, None]
        begin = first @ x[0]
        cost = 0.5 * float(np.sum(left * inner) + np.sum(x[0] * begin))
        count = len(x)
        links, ties, score = np.zeros((count, LINK, LINK)), np.zeros((count - 1, LINK, LINK)), np.zeros((count, LINK))
        pace = moving[:, None, None]
        for axis in range(3):
            at = slice(3 + axis, LINK, 3)
            links[:-1, at, at] += step.T @ known @ step * pace
            links[1:, at, at] += known * pace
            links[0, at, at] += first
            ties[:, at, at] -= step.T @ known * pace
            score[1:, at] += inner[..., axis]
            score[:-1, at] -= inner[..., axis] @ step
            score[0, at] += begin[:, axis]
        return cost, Chain(links, ties, np.zeros((count, LINK, 0)), np.zeros((0, 0)), score, np.zeros(0))


def added(chain: Chain, other: Chain) -> Chain:
    """Sum of normal equations and those of a prior on the links."""
    return dataclasses.replace(
        chain, links=chain.links + other.links, ties=chain.ties + other.ties, link_score=chain.link_score + other.link_score
    )


def spread_of(mean: Any, end: Any, gyro: Any, accel: Any, time: Any) -> Any:
    """(K, 9, 9) covariances of the inertial residuals for white noise with densities (K,).

    They depend on the mean specific force of a window (K, 3), and on the rotation from its end back to its beginning (K, 3, 3).
    """
    xp = array_module(mean, end)
    down = -xp.cross(xp.eye(3), mean[:, None])
    eye, square, up = xp.eye(3), -(down @ down), xp.swapaxes(down, 1, 2)  # an error of attitude rotates the specific force
    g, a = (level[:, None, None] ** 2 for level in (gyro, accel))
    speed, place = g * time**2 / 2 * end @ up, g * time**3 / 6 * end @ up
    both = a * time**2 / 2 * eye + g * time**4 / 8 * square
    rows = (
        (g * time * eye, speed, place),
        (xp.swapaxes(speed, 1, 2), a * time * eye + g * time**3 / 3 * square, both),
        (xp.swapaxes(place, 1, 2), xp.swapaxes(both, 1, 2), a * time**3 / 3 * eye + g * time**5 / 20 * square),
    )
    return xp.concatenate([xp.concatenate(row, axis=2) for row in rows], axis=1)


def whitened(found: Inertial, noise: Noise, time: float, broken: np.ndarray) -> np.ndarray:
    """(K, 9, 9) matrices that whiten the inertial residuals, for white noise of gyroscope and accelerometer."""
    gyro, accel = (np.broadcast_to(level, len(found.speed)) for level in (noise.gyro, noise.accel))
    matrix = spread_of(found.speed / time, np.swapaxes(found.rotation[:, -1], 1, 2), gyro, accel, time)
    matrix[broken] = np.diag(np.repeat([1.0, 10.0, 1.0], 3) ** 2)
    return np.linalg.inv(np.linalg.cholesky(matrix))


@dataclasses.dataclass
class Way:
    """Trajectory: attitude (K + 1, 3, 3), velocity, position and acceleration (K + 1, 3) at the ends of the windows, in world axes."""

    rotation: np.ndarray
    velocity: np.ndarray
    place: np.ndarray
    acceleration: np.ndarray

    @property
    def states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The states that the residuals of the sensors contain."""
        return self.rotation, self.velocity, self.place

    def moved(self, step: np.ndarray) -> "Way":
        """The trajectory after a step (K + 1, LINK)."""
        rotation = self.rotation @ exponential(step[:, :3])
        return Way(rotation, self.velocity + step[:, 3:6], self.place + step[:, 6:9], self.acceleration + step[:, 9:])


@dataclasses.dataclass
class Record:
    """Readings (n, 3) with gaps filled, and which of them are missing. The magnetometer is in units of the field."""

    accel: np.ndarray
    gyro: np.ndarray
    mag: np.ndarray
    mag_later: np.ndarray | None  # (n,) s, by how much later than its sample a reading of the magnetometer was taken
    there: np.ndarray  # (n,) whether a reading of the magnetometer exists
    broken: np.ndarray  # (K,) windows in which inertial samples are missing
    grid: Grid
    gravity: float
    earth: np.ndarray  # (3, 3) rotation of the Earth in a window

    @property
    def time(self) -> float:
        """Length of a window, s."""
        return self.grid.steps * self.grid.step

    def back(self, vector: np.ndarray, now: int | None = None) -> int:
        """`steps_back` for these parameters. It stays at `now` while the delay is near, so that the cost does not jump between steps."""
        part = -float(vector[MAG_DELAY]) / self.grid.step
        return now if now is not None and now - _NEAR < part < now + 1 + _NEAR else steps_back(self.grid, float(vector[MAG_DELAY]))

    def kept(self, back: int) -> np.ndarray:
        """(K, m) whether a reading of the magnetometer exists, in a window without missing inertial samples."""
        return self.there[self.grid.inner[:, :-1] - back] & ~self.broken[:, None]

    def windows(self, vector: np.ndarray, back: int) -> Windows:
        """The windows, interpolated for the delays in these parameters."""
        delays = float(vector[GYRO_DELAY]), float(vector[MAG_DELAY])
        return windows(self.grid, self.accel, self.gyro, self.mag, *delays, back, self.mag_later)


@dataclasses.dataclass
class Solution:
    """Parameters and trajectory at the end of a fit, with residuals and normal equations there."""

    vector: np.ndarray
    way: Way
    cost: float
    rows: Rows
    chain: Chain
    steps: int
    converged: bool
    eliminated: Eliminated
    free: np.ndarray
    counts: np.ndarray  # (K,) weights of the field residuals of each window
    back: int
    kept: np.ndarray  # (K, m) whether a reading of the magnetometer is used
    noise: Noise

    @property
    def weight(self) -> np.ndarray:
        return self.counts[:, None] * self.kept

    @property
    def field(self) -> np.ndarray:
        """(K, m, 3) field residuals in standard deviations, without the weights; zero where there is no reading."""
        return self.rows.field / self.counts[:, None, None]

    @property
    def model(self) -> DeviceModel:
        return model_of(self.vector)


@dataclasses.dataclass(frozen=True)
class Rests:
    """Rests: windows (K,), and standard deviations of the velocity (m/s) and of a window's rotation (rad) in them."""

    windows: np.ndarray
    speed: float = 2e-3
    turn: float = 1e-3

    @property
    def moving(self) -> np.ndarray:
        return 1.0 - self.windows

    @property
    def ends(self) -> np.ndarray:
        """(K + 1,) ends of windows at rest."""
        return np.concatenate([self.windows, [False]]) | np.concatenate([[False], self.windows])

    def rows(self, way: Way, place: Place) -> tuple[float, Chain]:
        """Half the sum of squares, and its part of the normal equations."""
        count, ends = len(way.velocity), self.ends
        links, ties, score = np.zeros((count, LINK, LINK)), np.zeros((count - 1, LINK, LINK)), np.zeros((count, LINK))
        # within a rest the position is not a Matern process; the acceleration after it starts from its stationary distribution
        weight = np.concatenate([np.full(3, self.speed**-2), np.full(3, (3 * place.speed**2 / place.reach) ** -2)])
        at = np.array([3, 4, 5, 9, 10, 11])
        x = np.concatenate([way.velocity, way.acceleration], axis=1) * ends[:, None]
        links[:, at, at] += weight * ends[:, None]
        score[:, at] += weight * x
        back = np.swapaxes(way.rotation[:-1], 1, 2) @ way.rotation[1:]
        turned = logarithm(back) * self.windows[:, None]
        own, relative = self.turn**-2 * self.windows[:, None, None], np.swapaxes(back, 1, 2)
        links[:-1, :3, :3] += own * np.eye(3)
        links[1:, :3, :3] += own * np.eye(3)
        ties[:, :3, :3] -= own * back
        score[1:, :3] += self.turn**-2 * turned
        score[:-1, :3] -= self.turn**-2 * np.einsum("kba,kb->ka", relative, turned)
        cost = 0.5 * float(np.sum(weight * x**2) + np.sum(turned**2) / self.turn**2)
        return cost, Chain(links, ties, np.zeros((count, LINK, 0)), np.zeros((0, 0)), score, np.zeros(0))


def solved(
    record: Record, vector: np.ndarray, way: Way, free: np.ndarray, noise: Noise, place: Place, counts: np.ndarray, steps: int = STEPS,
    rests: Rests | None = None, centre: np.ndarray | None = None,
) -> Solution:  # fmt: skip
    """Least squares from a start. `counts` (K,) are weights of the magnetometer's residuals, `centre` is the centre of the prior."""
    rests = Rests(np.zeros(len(record.grid.first), dtype=bool)) if rests is None else rests
    centre = vector if centre is None else centre
    wanted = [name.partition("[")[0] for name in np.array(NAMES)[free]]
    options = {"sensitivity": "gyro.g_sensitivity" in wanted, "lever": "lever" in wanted}
    sizes, damping = SIZES[free], 0.0
    back = record.back(vector)

    def at(vector, way, back):
        model, w = model_of(vector), record.windows(vector, back)
        found = inertial(model, w, **options)
        whiten, weight = whitened(found, noise, record.time, record.broken), counts[:, None] * record.kept(back)
        made = rows(way.states, w, found, model, whiten, weight / np.reshape(noise.mag, (-1, 1)), record.gravity, record.earth)
        prior, more = place.rows(way, record.time, rests.moving)
        if rests.windows.any():
            still, other = rests.rows(way, place)
            prior, more = prior + still, added(more, other)
        cost = 0.5 * float(np.sum(made.inertial**2) + np.sum(made.field**2) + np.sum(((vector - centre)[free] / sizes) ** 2)) + prior
        return cost, made, more

    cost, made, more = at(vector, way, back)

    def equations(vector, made, more):
        chain = added(chain_of(made, free), more)
        off = (vector - centre)[free] / sizes**2
        return dataclasses.replace(chain, corner=chain.corner + np.diag(sizes**-2.0), score=chain.score + off)

    chain = equations(vector, made, more)
    done, taken, before = False, 0, None
    for taken in range(1, steps + 1):  # noqa: B007
        known, stretch = chain.eliminated(), 1.0
        while True:
            move = -np.linalg.solve(known.information + damping * np.diag(sizes**-2.0), known.score)
            if stretch and before is not None:
                # steps that shrink slowly form a geometric series: take the sum of the remaining series in one step
                shrinks = float(before @ known.information @ move) / float(before @ known.information @ before)
                stretch = min(1 / (1 - shrinks), _FURTHEST) if _SLOW < shrinks < 1 else 1.0
                move = stretch * move
            promised = -0.5 * float(move @ known.score) - 0.5 * float(np.sum(chain.link_score * known.links(np.zeros(len(free)))))
            trial = vector.copy()
            trial[free] += move
            if not np.all(np.abs(trial[[GYRO_DELAY, MAG_DELAY]]) < REACH):
                trial[[GYRO_DELAY, MAG_DELAY]] = np.clip(trial[[GYRO_DELAY, MAG_DELAY]], -REACH, REACH)
            there = way.moved(known.links(move))
            found = at(trial, there, back)
            if found[0] <= cost * (1 + 1e-9) + 1e-6 or damping > 1e12:
                break
            if stretch > 1:
                stretch = 0.0
            else:
                damping = max(10 * damping, 1.0)
        before = None if stretch > 1 or damping else move
        done = abs(promised) < _SETTLED
        vector, way, (cost, made, more) = trial, there, found
        if (moved := record.back(vector, back)) != back:
            back, (cost, made, more) = moved, at(vector, way, moved)
        damping = damping / 10 if damping > 1 else 0.0
        chain = equations(vector, made, more)
        if done:
            break
    return Solution(vector, way, cost, made, chain, taken, done, chain.eliminated(), free, counts, back, record.kept(back), noise)
