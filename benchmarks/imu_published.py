"""The method behind the published scales of imu1.log and imu3.log (mikoff/imu-calib), written again in NumPy, beside jaxcal.

    python benchmarks/imu_published.py

The logs are in FOLDER/data/imu/mikoff, where FOLDER is JAXCAL_REFERENCE or ../shared. The method finds rests where the magnitude of the
rate stays below 0.13 rad/s for 60 samples, without the 60 samples before a motion. The vertical of a rest is its mean. Least squares then
gives twelve parameters of the gyroscope (matrix and bias) from the turns.
"""

import json
import os
import pathlib

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import jaxcal

ROOT = pathlib.Path(__file__).resolve().parents[1]
FOLDER = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", ROOT.parent / "shared")) / "data" / "imu" / "mikoff"
MARGIN, GRAVITY = 5, 9.81


def rests_of(gyro):
    """Start and stop of the rests according to the published flags."""
    still, count = np.zeros(len(gyro), dtype=bool), 60
    for i, fast in enumerate(np.linalg.norm(gyro, axis=1) >= 0.13):
        count = 0 if fast else count + 1
        still[i] = count > 60
        if fast:
            still[max(i - 60, 0) : i] = False
    edges = np.flatnonzero(np.diff(still.astype(int)))
    start, stop = edges[::2] - MARGIN + 1, edges[1::2] + MARGIN + 1  # start and stop of the motions
    return np.concatenate([[0], stop]), np.concatenate([start, [len(gyro) - 1]]), still


def published(accel, gyro, least):
    """Scales in %, their standard errors, angle errors after turns in mrad, and lengths of the rests; rests below `least` are not used."""
    start, stop, still = rests_of(gyro)

    def norms(p):
        return GRAVITY - np.linalg.norm((accel[still] - p[6:]) @ upper(p).T, axis=1)

    def upper(p):
        return np.array([[1 + p[0], p[3], p[4]], [0, 1 + p[1], p[5]], [0, 0, 1 + p[2]]])

    found = least_squares(norms, np.zeros(9)).x
    force = (accel - found[6:]) @ upper(found).T
    up = np.array([force[i:j].mean(axis=0) for i, j in zip(start, stop, strict=True)])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    enough = stop - start >= least
    kept = np.flatnonzero(enough[:-1] & enough[1:])
    size = 1 << int(np.max(start[1:] - stop[:-1]) - 1).bit_length()
    rate, inside = np.zeros((len(kept), size, 3)), np.zeros((len(kept), size, 1))
    for row, k in enumerate(kept):
        part = gyro[stop[k] : start[k + 1]]
        rate[row, : len(part)], inside[row, : len(part)] = part, 1.0

    def turned(p):
        steps = (rate - p[9:]) @ np.linalg.inv(np.eye(3) + p[:9].reshape(3, 3)).T * inside / 100.0
        turn = Rotation.from_rotvec(steps.reshape(-1, 3)).as_matrix().reshape(*rate.shape[:2], 3, 3)
        while turn.shape[1] > 1:
            turn = turn[:, ::2] @ turn[:, 1::2]
        return (np.einsum("sji,sj->si", turn[:, 0], up[kept]) - up[kept + 1]).ravel()

    fit = least_squares(turned, np.concatenate([np.zeros(9), np.median(gyro, axis=0)]), x_scale=0.01)
    error = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)) * 2 * fit.cost / (2 * len(kept) - 12))
    return 100 * fit.x[[0, 4, 8]], 100 * error[[0, 4, 8]], 1e3 * np.linalg.norm(fit.fun.reshape(-1, 3), axis=1), stop - start


if __name__ == "__main__":
    for name, table in json.loads((FOLDER / "published.json").read_text()).items():
        if name.startswith("_"):
            continue
        rows = np.loadtxt(FOLDER / name)
        accel, gyro = rows[:, :3], rows[:, 3:]
        print(f"{name}: published {np.array(table['gyroscope']['scale_percent'])} %")
        for title, least in (("all turns", 0), ("without rests below 0.3 s", 30)):
            scale, error, left, length = published(accel, gyro, least)
            rms = np.sqrt(np.mean(left**2))
            print(f"  the same method, {title}: {scale.round(3)} +- {error.round(3)} %")
            print(f"    left after a turn {rms:.2f} mrad rms, at most {left.max():.1f}; shortest rest {length.min()} samples")
        ours = jaxcal.imu.multi_position(jaxcal.Log(None, accel=accel, gyro=gyro, rate=100.0), gravity=GRAVITY)
        scale, error = (
            100 * (np.diag(ours.gyro.matrix) - 1),
            100 * ours.estimate.select("gyro.matrix[0,0]", "gyro.matrix[1,1]", "gyro.matrix[2,2]").error,
        )
        rms = 1e3 * np.sqrt(np.mean(ours.residual_turn**2))
        print(f"  jaxcal: {scale.round(3)} +- {error.round(3)} %")
        print(f"    left after a turn {rms:.2f} mrad rms, held out {1e3 * ours.held_out[1]:.2f} a component")
