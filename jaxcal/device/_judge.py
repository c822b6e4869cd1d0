"""What a recording tells of the parameters of a device: their errors with correlated and slow noise, and terms that the model lacks."""

import dataclasses
import itertools

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import summed_product
from .._units import factor
from ..fitting import Chain
from ..fitting._serial import BLOCKS, CHANCE, leave_out_pieces
from ..imu._model import LEVEL
from ..noise import Noise, mean_covariance
from ._model import AT, NAMES
from ._noise_floor import CLEAR, markov_spectrum, white_and_markov
from ._solve import ENOUGH, LENGTHS
from ._state import SIZES, UNSEEN, Solution
from ._windows import ACCEL_POLE, GYRO_POLE, Record

_DAY = factor("d", "time")  # s, over which the bias is a mean: the time within which a calibration is used


@dataclasses.dataclass(frozen=True)
class Known:
    """What a recording tells of the free parameters: their errors, whether its parts agree, and what the model lacks."""

    covariance: np.ndarray
    freedom: np.ndarray  # (p,)
    ratio: float
    seen: np.ndarray  # (p,) whether the recording determines a parameter
    held_out: dict[str, float]  # sensor -> rms residual of parts that were left out, in its noise
    apart: float | None  # variance of a parameter between parts over that of the noise, where it is clearly larger: the largest
    lacks: dict[str, float]  # terms that the model lacks, see the function of this name


def known(found: Solution, record: Record, wander: dict[str, Noise]) -> Known:
    """Errors: from the information if parts of the recording agree, otherwise from fits that leave out parts. A parameter for which
    alone these errors are clearly larger has them, too.

    The score of a part comes from its residuals at the best trajectory. If the noise is as the model assumes, its covariance is the
    information of the part. The slow noise of the residuals adds to the errors, and so does `wander`, that of the biases, if the caller
    gives it.
    """
    normal, score, pushed, rows = _by_window(found)
    hats, scores = _pieces(normal), _pieces(score)
    whole = found.eliminated.information
    prior = np.diag(SIZES[found.free] ** -2.0)
    matrix = np.linalg.inv(whole)
    seen = ~found.unseen
    held_out = _predicted(found, normal, score, prior, *rows)
    # test whether sixths of the recording need parameters of their own
    sixth = hats.reshape(BLOCKS, -1, *hats.shape[1:]).sum(axis=1), scores.reshape(BLOCKS, -1, hats.shape[1]).sum(axis=1)
    scale = SIZES[found.free]
    statistic, count = 0.0, -int(seen.sum())
    for hat, score in zip(*sixth, strict=True):
        values, vectors = np.linalg.eigh(hat * np.outer(scale, scale))
        strong = values > 25.0
        statistic += float(np.sum((vectors.T @ (scale * score))[strong] ** 2 / values[strong]))
        count += int(strong.sum())
    ratio = statistic / max(count, 1)
    few, missing = np.full(len(matrix), BLOCKS - 1.0), lacks(found, record, ratio)
    more = slow_noise(found, record.time, pushed, wander)
    apart = leave_out_pieces(hats, scores, prior) + matrix @ prior @ matrix
    there = np.isfinite(apart).all()
    if there and count > 0 and scipy.special.chdtrc(count, statistic) < CHANCE:
        return Known(apart, few, ratio, seen, held_out, ratio, missing)
    plain = matrix * max(ratio, 1.0) + matrix @ more @ matrix
    excess = np.diag(apart) / np.diag(plain) if there else np.ones(len(matrix))
    wide = seen & (scipy.special.chdtrc(few, few * excess) < CHANCE / len(few))
    size = np.sqrt(np.where(wide, excess, 1.0))
    most = excess[wide].max() if wide.any() else None
    return Known(plain * np.outer(size, size), np.where(wide, few, np.inf), ratio, seen, held_out, most, missing)


def _predicted(
    found: Solution, normal: np.ndarray, score: np.ndarray, prior: np.ndarray, jacobian: np.ndarray, residual: np.ndarray
) -> dict[str, float]:
    """Rms residual of each sensor, in its noise, in sixths of the recording, each with parameters from the other five.

    These parameters are one Gauss-Newton step from those of the whole recording, and the trajectory follows. NaN if the other five do
    not determine the parameters.
    """
    whole, total, left = normal.sum(axis=0) + prior, score.sum(axis=0), residual.copy()
    edges = np.round(np.arange(BLOCKS + 1) * len(normal) / BLOCKS).astype(int)
    scale = SIZES[found.free]
    for a, b in itertools.pairwise(edges):
        rest = whole - normal[a:b].sum(axis=0)
        if np.linalg.eigvalsh(rest * np.outer(scale, scale))[0] < UNSEEN**-2 / 2:
            return dict.fromkeys(("gyro", "accel", "magnetometer"), float("nan"))
        left[a:b] -= jacobian[a:b] @ np.linalg.solve(rest, total - score[a:b].sum(axis=0))
    number = {"gyro": 3 * len(left), "accel": 3 * len(left), "magnetometer": 3 * max(found.kept.sum(), 1)}
    columns = {"gyro": slice(0, 3), "accel": slice(3, 6), "magnetometer": slice(9, 9 + found.rows.field[0].size)}
    return {name: float(np.sqrt(np.sum(left[:, own] ** 2) / number[name])) for name, own in columns.items()}


def _pieces(values: np.ndarray) -> np.ndarray:
    """Sums over four pieces of each block of the recording."""
    edges = np.round(np.linspace(0, len(values), 4 * BLOCKS + 1)).astype(int)
    return np.array([values[a:b].sum(axis=0) for a, b in itertools.pairwise(edges)])


def _by_window(found: Solution) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """J'J (K, p, p) and J'r (K, p) of all windows, derivatives of J'r by biases in them, and (J, r). J has the trajectory eliminated."""
    free, carried, rows = found.free, -found.eliminated.carried, found.rows
    size, count = len(NAMES), len(rows.inertial)
    first, second = carried[:-1], carried[1:]
    by = rows.inertial_by
    inertial = by[:, :, free] + by[:, :, size : size + 9] @ first[:, :9] + by[:, :, size + 9 :] @ second[:, :9]
    field = rows.field_by[..., free] + rows.field_by[..., size:] @ first[:, None, :3]
    jacobian, residual = [inertial, field.reshape(count, -1, len(free))], [rows.inertial, rows.field.reshape(count, -1)]
    start, *ties = found.prior[1], found.prior[0], *found.prior[2:]
    for tie in ties:
        jacobian.append(tie.here[:count] @ first + (0.0 if tie.after is None else tie.after @ second))
        residual.append(tie.residual[:count])
    j, r = np.concatenate(jacobian, axis=1), np.concatenate(residual, axis=1)
    normal, score = np.swapaxes(j, 1, 2) @ j, np.einsum("kra,kr->ka", j, r)
    # the first state has a prior of its own
    begin = start.here[0] @ carried[0]
    normal[0] += begin.T @ begin
    score[0] += begin.T @ start.residual[0]
    pushed = {}
    for sensor, field in (("accel", "accel.bias"), ("gyro", "gyro.bias"), ("mag", "magnetometer.hard_iron")):
        alone = np.concatenate([by[:, :, AT[field]], rows.field_by[..., AT[field]].reshape(count, -1, 3)], axis=1)
        pushed[sensor] = np.swapaxes(j[:, : alone.shape[1]], 1, 2) @ alone
    return normal, score, pushed, (j, r)


def lacks(found: Solution, record: Record, ratio: float) -> dict[str, float]:
    """Terms that the model lacks, with their sizes: score tests for a "gradient" of the field (of the field per metre), a "loose"
    magnetometer, which turns with angular acceleration and specific force (rad rms), a "drift" of the gyroscope's bias (rad/s along
    the recording), and a "low_pass" of accelerometer or gyroscope (s^2) unless it was fitted.

    Each test lets all parameters and the trajectory vary together with the term. It changes no estimate.
    """
    turn, rows, own = found.way.rotation[:-1, None] @ found.moved.to_reading, found.rows, AT["gyro.bias"]
    part = (np.arange(record.grid.steps)[:, None] + 0.5) / record.grid.steps
    place = found.way.place[:-1, None] * (1 - part) + found.way.place[1:, None] * part
    x, y, z = np.moveaxis(place, -1, 0)
    zero, iron, back = np.zeros_like(x), np.asarray(found.model.magnetometer.soft_iron), np.swapaxes(turn, 2, 3)
    # symmetric gradients without trace: a static field in air has neither curl nor divergence
    fields = np.stack(
        [np.stack(column, axis=-1) for column in ((x, zero, -z), (zero, y, -z), (y, x, zero), (z, zero, x), (zero, z, y))], axis=-1
    )
    force = np.diff(found.way.velocity, axis=0)[:, None, :, None] / record.time + np.array([[0.0], [0.0], [record.gravity]])
    pulls = (np.gradient(found.moved.rate, record.grid.step, axis=1)[:, :-1], (back @ force)[..., 0])
    seen = (back @ found.model.world_field)[..., None, :]
    leaning = [np.swapaxes(np.cross(by[..., None] * np.eye(3), seen), 2, 3) for by in pulls]
    along = (np.arange(len(turn)) - (len(turn) - 1) / 2) / len(turn)
    scale, poles = found.weight[..., None, None], [ACCEL_POLE, GYRO_POLE]
    terms = {"gradient": scale * (iron @ back @ fields), "loose": scale * (iron @ np.concatenate(leaning, axis=-1))}
    asked = {name: (columns, np.zeros((len(turn), 9, columns.shape[-1]))) for name, columns in terms.items()}
    asked["drift"] = rows.field_by[..., own] * along[:, None, None, None], rows.inertial_by[..., own] * along[:, None, None]
    if ACCEL_POLE not in found.free:
        asked["low_pass"] = rows.field_by[..., poles], rows.inertial_by[..., poles]
    score, information = _asked(found, *(np.concatenate(parts, axis=-1) for parts in zip(*asked.values(), strict=True)))
    sizes, stop, score = {}, 0, -score
    for name, (columns, _) in asked.items():
        part = slice(stop, stop := stop + columns.shape[-1])
        c = np.linalg.solve(information[part, part], score[part])
        if scipy.special.chdtrc(len(c), float(score[part] @ c) / max(ratio, 1.0)) < LEVEL:
            if name == "gradient":
                c = np.array([c[0], c[1], c[0] + c[1], *(np.sqrt(2) * c[2:])])
            if name == "loose":
                c = c * np.repeat([np.sqrt(np.mean(by**2)) for by in pulls], 3)
            sizes[name] = float(c.max() if name == "low_pass" else np.linalg.norm(c))
    return sizes


def _asked(found: Solution, field: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Score and information of further columns of the rows, (K, m, 3, q) and (K, 9, q), with parameters and trajectory eliminated."""
    chain, free, rows = found.chain, found.free, found.rows
    size, count = len(NAMES), len(field)
    flat = field.reshape(count, -1, field.shape[-1])
    own = rows.field_by[..., free].reshape(count, -1, len(free))
    here = rows.field_by[..., size:].reshape(count, -1, 3)
    by = np.swapaxes(rows.inertial_by, 1, 2) @ inner
    border = np.zeros((*chain.border.shape[:2], flat.shape[-1]))
    border[:-1, :3] = np.swapaxes(here, 1, 2) @ flat
    border[:-1, :9] += by[:, size : size + 9]
    border[1:, :9] += by[:, size + 9 :]
    between = summed_product(own, flat) + by[:, free].sum(axis=0)
    corner = summed_product(flat, flat) + summed_product(inner, inner)
    push = np.einsum("krq,kr->q", flat, rows.field.reshape(count, -1)) + np.einsum("krq,kr->q", inner, rows.inertial)
    more = Chain(
        chain.links, chain.ties, np.concatenate([chain.border, border], axis=2), np.block([[chain.corner, between], [between.T, corner]]),
        chain.link_score, np.append(chain.score, push),
    )  # fmt: skip
    whole = more.eliminated()
    p = len(free)
    gain = np.linalg.solve(whole.information[:p, :p], np.column_stack([whole.information[:p, p:], whole.score[:p]]))
    left = whole.information[p:, p:] - whole.information[p:, :p] @ gain[:, :-1]
    return whole.score[p:] - whole.information[p:, :p] @ gain[:, -1], left


def slow_noise(found: Solution, time: float, felt_by: dict[str, np.ndarray], wander: dict[str, Noise]) -> np.ndarray:
    """(p, p) variance of the score from the noise that the levels of the fit do not contain.

    The noise of a sensor is described as white noise and a Gauss-Markov process. Their powers and the time constant are those that explain
    the spectrum of the residuals in octaves. The fit absorbs a part of the noise. Fits to white noise show how large this part is at each
    frequency. At each frequency, the power above the level of the fit counts. `felt_by` (K, p, 3) is the change of the score by a bias of
    the sensor in one window. That of the biases, `wander`, adds if the caller gives it.
    """
    total = np.zeros(2 * felt_by["mag"].shape[1:2])
    for sensor, noise in wander.items():
        total = total + _wandering(felt_by[sensor], noise, time)
    resting = found.rests.windows
    number = found.kept.sum() / max(np.count_nonzero(found.kept.any(axis=1)), 1)
    keep = np.exp(-1 / np.array(LENGTHS[1:]))
    for name, (seen, drawn) in found.residuals.items():
        count = len(seen)
        level = np.broadcast_to(getattr(found.noise, name), count) ** 2 * (time / number if name == "mag" else 1.0)
        parts = [which for which in (resting, ~resting) if which.sum() >= ENOUGH]
        # rests show the noise of the inertial sensors, which motion hides; the attitude of a rest absorbs that of the magnetometer
        read = parts[-1] if name == "mag" else parts[0]
        ratio, freedom, shapes = _octaves(seen, drawn, read, keep)
        white, slow, best, gain = white_and_markov(level[read][0] * ratio, shapes, freedom)
        if gain < CLEAR:
            continue
        spectrum = white + slow * markov_spectrum(keep[best : best + 1], np.pi * np.arange(count + 1) / count)
        felt = np.zeros((count + 1, *felt_by[name].shape[1:]), dtype=complex)
        for which in parts:
            more = np.sqrt(np.maximum(spectrum - level[which][0], 0.0) / time)
            felt += more[:, None, None] * np.fft.rfft(felt_by[name] * which[:, None, None], 2 * count, axis=0)
        felt[1:-1] *= np.sqrt(2)  # negative frequencies
        total = total + np.einsum("fpa,fqa->pq", felt, felt.conj(), optimize=True).real / (2 * count)
    return total


def _wandering(pushed: np.ndarray, noise: Noise, time: float) -> np.ndarray:
    """(p, p) variance of the score from a bias that wanders about its mean over a day, with the recording in its middle.

    `pushed` (K, p, 3) is the change of the score by a bias in one window. Flicker has no mean over all time.
    """
    dwell = np.concatenate([[_DAY / 2], np.full(len(pushed), time), [_DAY / 2]])
    matrix = mean_covariance(noise, np.cumsum(dwell) - dwell, dwell)[1:-1, 1:-1]
    return np.einsum("kpa,kl,lqa->pq", pushed, matrix, pushed, optimize=True)


def _octaves(seen: np.ndarray, drawn: np.ndarray, which: np.ndarray, keep: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Power of the residuals over that of fits to white noise, its degrees of freedom, and this ratio for each process (c, octaves)."""
    count = len(which)
    edges = [1, 3]
    while 4 * edges[-1] < count:
        edges.append(2 * edges[-1])
    powers = [np.abs(np.fft.rfft(y * which.reshape(-1, *np.ones(y.ndim - 1, dtype=int)), axis=0)) ** 2 for y in (seen, drawn)]
    own, null = (np.add.reduceat(power, edges, axis=0) for power in powers)
    own, null = own.sum(axis=1), null.sum(axis=1)
    mean = null.mean(axis=-1)
    lag = np.minimum(np.arange(2 * count), 2 * count - np.arange(2 * count))
    both = np.fft.irfft(np.abs(np.fft.rfft(which, 2 * count)) ** 2, 2 * count)  # pairs of these windows at each lag
    keep = np.append(keep, 0.0)[:, None]
    power = np.fft.rfft((1 - keep) / (1 + keep) * keep**lag * both, axis=1).real[:, ::2]
    shapes = np.add.reduceat(power, edges, axis=1)
    return own / mean, 2 * (mean / null.std(axis=-1)) ** 2, shapes[:-1] / shapes[-1]
