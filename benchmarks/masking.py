"""What the loss of one sample in a hundred changes in the noise of a real record.

    python benchmarks/masking.py [--masks 5] [--channels imu1:5,imu2:0]

For every channel of two recordings of an ADIS16405 (10^6 samples each): changes of the squared coefficients N, B and K, in standard errors
of the complete record, largest over the masks; verdicts of the complete record, and in how many masks all of them are the same.
The samples are lost at random. The recordings are searched for in JAXCAL_REFERENCE or ../shared.
"""

import argparse
import os
import pathlib

import numpy as np

import jaxcal

FOLDER = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", pathlib.Path(__file__).resolve().parents[2] / "shared")) / "data" / "adis16405"
TERMS = "NBK"


def squares(fit):
    return np.array([float(fit.noise.coefficient(term)) ** 2 for term in TERMS])


def changes(y, rate, masks):
    whole = jaxcal.noise.fit(y, rate)
    errors = np.sqrt([whole.covariance[term, term] for term in TERMS])
    moved, same = [], 0
    for seed in range(1, masks + 1):
        masked = y.copy()
        masked[np.random.default_rng(seed).choice(len(y) - 1, len(y) // 100, replace=False)] = np.nan
        part = jaxcal.noise.fit(masked, rate)
        moved.append(np.abs(squares(part) - squares(whole)) / np.where(errors > 0.0, errors, np.inf))
        same += part.presence == whole.presence
    return np.max(moved, axis=0), same, whole


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--masks", type=int, default=5)
    parser.add_argument("--channels", default=",".join(f"imu{number}:{channel}" for number in (1, 2) for channel in range(6)))
    options = parser.parse_args()
    print("channel      N      B      K   same verdicts   verdicts of N, B, K")
    for name in options.channels.split(","):
        recording, channel = name.split(":")
        with np.load(FOLDER / f"{recording}.npz") as file:
            y, rate = file["counts"][:, int(channel)] * file["scale"][int(channel)], float(file["fs"])
        moved, same, whole = changes(y, rate, options.masks)
        cells = " ".join(f"{value:6.2f}" for value in moved)
        verdicts = ", ".join(whole.presence[term] for term in TERMS)
        print(f"{name:8s} {cells} {same:9d} of {options.masks}  {verdicts}", flush=True)
