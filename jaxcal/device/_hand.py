"""Motion of a device in a hand, as closed formulas of time: attitude, position, and their derivatives.

Position and angles are sums of sinusoids, and the attitude is a product of rotations about fixed axes. All derivatives are
closed formulas; nothing is integrated numerically. A simulator that integrates as the estimator does would hide the errors
that both make.

A rest slows the motion's own clock: the motion at the time t is that of the clock's reading c(t), and c'(t) falls smoothly
from 1 to 0 and rises again. So a rest is exact, wherever the motion happens to be.
"""

import dataclasses

import numpy as np
import scipy  # loads its parts when they are first used
from jaxtyping import Bool, Float

from .._arrays import from_vector
from .._units import STANDARD_GRAVITY

#: number of sinusoids in one signal, and their highest frequency in units of the corner frequency; Hz: that of the position; number of
#: samples for which the sinusoids are computed at once
_LINES, _HIGHEST, _PACE, _CHUNK = 160, 20.0, 0.3, 8192
#: standard deviation of the angle of each rotation, rad, large enough to cover all attitudes; Hz: band of the tremor of a hand; m:
#: distance from the wrist to the device
_SPREAD, _TREMOR, _WRIST = 2.0, (8.0, 12.0), 0.1
#: s: time in which the motion stops or starts, and shortest motion before and after each rest; pace of the motion, relative to free
#: motion, while a hand holds the device still
_EASE, BETWEEN, DRIFT = 0.6, 1.5, 0.005


@dataclasses.dataclass(frozen=True)
class HandMotion:
    """The true motion at some times. World axes: x to magnetic north, y to the west, z up. Device axes: those of the accelerometer.

    Attributes
    ----------
    time : (n,) s.
    attitude : (n, 3, 3) rotation that takes device coordinates to world coordinates.
    rate, angular_acceleration : (n, 3) of the device against the world, in device coordinates, rad/s and rad/s^2.
    position, velocity, acceleration : (n, 3) of the device's origin in world coordinates, m, m/s and m/s^2.
    force : (n, 3) specific force at the device's origin in device coordinates, m/s^2.
    resting : (n,) whether the device rests.
    clock : (n, 3) the motion's own clock in s, and its first and second derivative by time; the first is 0 at rest.

    Examples
    --------
    >>> import jaxcal
    >>> log, device, motion = jaxcal.device.simulate(30.0, 50.0, seed=1)
    >>> type(motion).__name__, motion.attitude.shape, motion.force.shape
    ('HandMotion', (1500, 3, 3), (1500, 3))
    """

    time: Float[np.ndarray, " n"]
    attitude: Float[np.ndarray, "n 3 3"]
    rate: Float[np.ndarray, "n 3"]
    angular_acceleration: Float[np.ndarray, "n 3"]
    position: Float[np.ndarray, "n 3"]
    velocity: Float[np.ndarray, "n 3"]
    acceleration: Float[np.ndarray, "n 3"]
    force: Float[np.ndarray, "n 3"]
    resting: Bool[np.ndarray, " n"]
    clock: Float[np.ndarray, "n 3"]


class Waves:
    """Gaussian signals of unit variance: sums of sinusoids whose cosine and sine coefficients are independent normal variables."""

    def __init__(self, rng: np.random.Generator, omega: np.ndarray, power: np.ndarray, signals: int):
        self.omega = omega
        self.cosine, self.sine = rng.normal(size=(2, len(omega), signals)) * np.sqrt(power)[:, None]

    @staticmethod
    def of_hand(rng: np.random.Generator, corner: float, signals: int) -> "Waves":
        """Signals with the density of a Matern process of order 5/2, in proportion to (1 + (f / corner)^2)^-3, below a highest frequency.

        The frequencies are drawn one from each of many bands, narrow at low frequencies.
        """
        edges = corner * ((1 + _HIGHEST) ** (np.arange(_LINES + 1) / _LINES) - 1)
        frequency = edges[:-1] + rng.uniform(size=_LINES) * np.diff(edges)
        # normalised by the density over all frequencies, so that `corner` is the corner frequency of the Matern process
        power = np.diff(edges) / corner * (1 + (frequency / corner) ** 2) ** -3 * 16 / (3 * np.pi)
        return Waves(rng, 2 * np.pi * frequency, power, signals)

    @staticmethod
    def of_tremor(rng: np.random.Generator, signals: int) -> "Waves":
        """Signals in the band of the tremor of a hand."""
        lines = _LINES // 4
        omega = 2 * np.pi * (_TREMOR[0] + (_TREMOR[1] - _TREMOR[0]) * (np.arange(lines) + rng.uniform(size=lines)) / lines)
        return Waves(rng, omega, np.full(lines, 1 / lines), signals)

    def at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n, signals) values, first and second derivatives."""
        w, out = self.omega[:, None], np.empty((3, len(time), self.cosine.shape[1]))
        for start in range(0, len(time), _CHUNK):
            part = slice(start, start + _CHUNK)
            angle = time[part, None] * self.omega
            c, s = np.cos(angle), np.sin(angle)
            out[0, part] = c @ self.cosine + s @ self.sine
            out[1, part] = c @ (w * self.sine) - s @ (w * self.cosine)
            out[2, part] = -(c @ (w**2 * self.cosine) + s @ (w**2 * self.sine))
        return out[0], out[1], out[2]


class Pauses:
    """The rests of a recording: how much they slow the motion at each time."""

    def __init__(self, starts: np.ndarray, ends: np.ndarray, depth: float):
        self.starts, self.ends, self.depth = starts, ends, depth

    def at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Clock; a factor (1 in motion, 0 at rest), its first and second derivative; and whether the device rests."""
        clock, pace, change, resting = time.copy(), np.ones(len(time)), np.zeros(len(time)), np.zeros(len(time), bool)
        curvature = np.zeros(len(time))
        for start, end in zip(self.starts, self.ends, strict=True):
            for edge, sign in ((start - _EASE, 1.0), (end, -1.0)):
                u = np.clip((time - edge) / _EASE, 0, 1)
                # integral of the smooth step u^3 (10 - 15 u + 6 u^2), which grows linearly after the step; then step and derivatives
                whole = _EASE * u**4 * (2.5 - 3 * u + u**2) + np.maximum(time - edge - _EASE, 0)
                clock -= self.depth * sign * whole
                pace -= sign * u**3 * (10 - 15 * u + 6 * u**2)
                change -= sign * 30 * u**2 * (1 - u) ** 2 / _EASE
                curvature -= sign * 60 * u * (1 - u) * (1 - 2 * u) / _EASE**2
            resting |= (time >= start) & (time <= end)
        return clock, pace, change, curvature, resting


class Hand:
    """One motion, which can be evaluated at any times.

    Parameters
    ----------
    rng : random numbers that determine the motion.
    pauses : rests of the motion.
    turns : "free", "one axis" or "no tilt".
    reach : m, standard deviation of each coordinate.
    swing : rad/s, root mean square rate about each axis of "free".
    tremor : m, root mean square displacement along each axis.
    held : whether the tremor continues in the rests.
    arm : (3,) m, position of the device relative to the point about which the hand rotates it, in device axes.
    """

    def __init__(
        self, rng: np.random.Generator, pauses: Pauses, *, turns: str, reach: float, swing: float, tremor: float, held: bool,
        arm: np.ndarray,
    ):  # fmt: skip
        self.pauses, self.reach, self.tremor, self.held, self.arm = pauses, reach, tremor, held, arm
        # always draw all random numbers, so that an option changes only the part of the motion that it concerns
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        start = rng.normal(size=4)
        self.place = Waves.of_hand(rng, _PACE, 3)
        # the rate of an angle with this density has the standard deviation spread * 2 pi corner / sqrt(3)
        self.turn = Waves.of_hand(rng, swing * np.sqrt(3) / (2 * np.pi * _SPREAD), 3)
        self.shake = Waves.of_tremor(rng, 6)
        self.start = np.eye(3)
        if turns == "no tilt":
            self.axes = np.array([[0.0, 0.0, 1.0]])
        else:
            self.axes = axes.T if turns == "free" else axes.T[:1]
            self.start = scipy.spatial.transform.Rotation.from_quat(np.roll(start, -1)).as_matrix()

    def at(self, time: np.ndarray) -> HandMotion:
        """The motion at `time` (n,), in s."""
        clock, pace, change, curvature, resting = self.pauses.at(time)
        clock_pace, clock_change = 1 - self.pauses.depth * (1 - pace), self.pauses.depth * change
        place, velocity, acceleration = _slowed(self.place.at(clock), clock_pace, clock_change)
        angle, speed, growth = _slowed(self.turn.at(clock), clock_pace, clock_change)
        shake, shake_1, shake_2 = self.shake.at(time)
        if not self.held:
            # on a table the tremor stops, with the same smooth steps
            p, c, k = pace[:, None], change[:, None], curvature[:, None]
            shake, shake_1, shake_2 = p * shake, p * shake_1 + c * shake, p * shake_2 + 2 * c * shake_1 + k * shake
        place, velocity, acceleration = (
            self.reach * smooth + self.tremor * fine[:, :3]
            for smooth, fine in ((place, shake), (velocity, shake_1), (acceleration, shake_2))
        )
        attitude = np.broadcast_to(self.start, (len(time), 3, 3))
        rate, spin = np.zeros((2, len(time), 3))
        small = self.tremor / _WRIST
        turns = [(axis, _SPREAD * angle[:, i], _SPREAD * speed[:, i], _SPREAD * growth[:, i]) for i, axis in enumerate(self.axes)]
        turns += [(np.eye(3)[i], small * shake[:, 3 + i], small * shake_1[:, 3 + i], small * shake_2[:, 3 + i]) for i in range(3)]
        for axis, turned, fast, faster in turns:
            one = from_vector(turned[:, None] * axis)
            attitude = attitude @ one
            # express the rate so far in the axes after this rotation, which rotate about `axis` at the rate `fast`
            rate, spin = (np.einsum("nji,nj->ni", one, vector) for vector in (rate, spin))
            spin = spin - fast[:, None] * np.cross(axis, rate) + faster[:, None] * axis
            rate = rate + fast[:, None] * axis
        swept = np.cross(rate, self.arm)
        whirled = np.cross(spin, self.arm) + np.cross(rate, swept)
        for vector, own in ((place, np.broadcast_to(self.arm, place.shape)), (velocity, swept), (acceleration, whirled)):
            vector += np.einsum("nij,nj->ni", attitude, own)
        force = np.einsum("nji,nj->ni", attitude, acceleration + np.array([0.0, 0.0, STANDARD_GRAVITY]))
        return HandMotion(
            time, attitude, rate, spin, place, velocity, acceleration, force, resting, np.stack([clock, clock_pace, clock_change], axis=1)
        )


def _slowed(
    signal: tuple[np.ndarray, np.ndarray, np.ndarray], pace: np.ndarray, change: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A signal of the clock, with its derivatives by time from the chain rule."""
    value, first, second = signal
    return value, first * pace[:, None], second * pace[:, None] ** 2 + first * change[:, None]
