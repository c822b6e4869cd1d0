"""Sensors, directions and headings that the tests share; the numbers come from the papers or methods that are named."""

import numpy as np

from jaxcal.magnetometer import MagModel, body_field, heading, scenario

#: sensor of the magnetometer paper's simulation; the field is assumed to be that at Ankara, 47 uT with a dip of 57 degrees
PAPER = MagModel(
    np.linalg.inv([[0.9847, -0.2311, -0.0363], [-0.2311, 1.3609, -0.3391], [-0.0363, -0.3391, 0.8710]]),
    np.array([2.1746, 5.1520, 10.2458]),
)
FIELD, DIP = 47.0, np.deg2rad(57.0)
#: a sensor with small distortions, for a field of magnitude 1
MILD = MagModel(np.array([[1.10, 0.06, -0.04], [0.06, 0.92, 0.05], [-0.04, 0.05, 1.0]]), np.array([0.8, -0.5, 0.3]))
HEADINGS = np.deg2rad([2.4, 77.4, 115.5, 167.5, 222.6, 249.4, 300.3, 356.1])


def directions(count, seed, coverage="full"):
    """Random unit vectors, uniform over the sphere, over its upper half, or over a band of 30 degrees on both sides of the equator."""
    rng = np.random.default_rng(seed)
    found = np.zeros((0, 3))
    while len(found) < count:
        u = rng.normal(size=(4 * count, 3))
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        kept = {"full": u[:, 2] > -2, "hemisphere": u[:, 2] > 0, "band": np.abs(u[:, 2]) < 0.5}[coverage]
        found = np.concatenate([found, u[kept]])
    return found[:count]


def readings(sensor, field, sigma, seed):
    return sensor.measure(field) + sigma * np.random.default_rng([seed, 1]).normal(size=field.shape)


def paper_readings(name, sigma, seed, **options):
    attitudes = scenario(name, seed=seed, **options)
    return readings(PAPER, body_field(attitudes, FIELD, DIP), sigma, seed)


def heading_errors(model, sensor=PAPER, field=FIELD, dip=DIP, steep=False, headings=HEADINGS):
    """Heading errors in degrees of a level sensor without noise; `steep` allows fields that are too steep for `heading`."""
    level = np.stack([headings, 0 * headings, 0 * headings], axis=1)
    up = np.tile([0.0, 0.0, -9.81], (len(headings), 1))
    corrected = model.correct(sensor.measure(body_field(level, field, dip)))
    found = np.arctan2(-corrected[:, 1], corrected[:, 0]) if steep else heading(corrected, up)
    return np.rad2deg(np.angle(np.exp(1j * (found - headings))))


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def direction_error(model, sensor, seed=0):
    """Root mean square angle between true and corrected directions over the sphere, in degrees."""
    u = directions(500, seed)
    y = model.correct(sensor.measure(u))
    cosine = np.sum(u * y, axis=1) / np.linalg.norm(y, axis=1)
    return np.rad2deg(rms(np.arccos(np.clip(cosine, -1, 1))))


def bound(sensor, field, z, sigma):
    """True shape matrix, and the inverse information of the orthogonal distances, computed from their definition."""
    inverse = np.linalg.inv(np.asarray(sensor.soft_iron)) / field
    shape = inverse.T @ inverse
    normal = 2 * z @ shape
    x, y, w = z.T
    rows = np.column_stack([x * x, 2 * x * y, y * y, 2 * x * w, 2 * y * w, w * w, -normal]) / np.linalg.norm(normal, axis=1)[:, None]
    column = np.linalg.norm(rows, axis=0)
    return shape, sigma**2 * np.linalg.inv((rows / column).T @ (rows / column)) / np.outer(column, column)


def least_heading_error(sensor, field, z, sigma, dip=DIP):
    """Cramer-Rao bound of the rms heading error of a level sensor, in degrees; `z` has readings relative to the hard iron."""
    shape, covariance = bound(sensor, field, z, sigma)
    headings = np.arange(24) * np.pi / 12
    level = np.stack([headings, 0 * headings, 0 * headings], axis=1)

    def root(a):
        values, vectors = np.linalg.eigh(a)
        return (vectors * np.sqrt(values)) @ vectors.T

    m = body_field(level, 1.0, dip) @ np.linalg.inv(root(shape))

    def off(step):
        a, b = np.zeros((3, 3)), step[6:]
        a[np.tril_indices(3)] = step[:6]  # order: xx, xy, yy, xz, yz, zz
        y = (m - b) @ root(shape + a + np.tril(a, -1).T)
        return np.angle(np.exp(1j * (np.arctan2(-y[:, 1], y[:, 0]) - headings)))

    size = 1e-5 * np.repeat([np.abs(shape).max(), np.abs(shape).max() ** -0.5], [6, 3])
    slopes = np.stack([(off(h * e) - off(-h * e)) / (2 * h) for h, e in zip(size, np.eye(9), strict=True)], axis=1)
    return np.rad2deg(np.sqrt(np.mean(np.sum(slopes @ covariance * slopes, axis=1))))
