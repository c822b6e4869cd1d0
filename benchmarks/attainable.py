"""What a record of case A can tell about K: without `jaxcal`, from the exact law of the ordinates and the true structure of the noise.

    python benchmarks/attainable.py [--records 3000] [--powers 17,19]

estimates: bias and rmse of K in % of the truth, of the maximum of the likelihood and of posterior means, medians and modes under several
weak priors, beside the Cramer-Rao bound. N, B and K are on a grid that holds the whole likelihood; Q is known to be zero.
presence: share of records with and without K in which twice the log likelihood ratio of K exceeds a level.
event: how well an event (60 deg/h, 250 s, from the middle) without K can be told from K without an event, where the priors are known:
how many of the records with K are said to be an event if 3, 5 or 10 % of the events are not. By the exact Bayes factor over a grid of
starts, time constants, B and K, and by the ratio of the maxima.
"""

import argparse

import numpy as np
import scipy.fft
from scipy.special import logsumexp

DEG, DT = np.pi / 180, 0.01
N, B, K = 0.25 * DEG / 60, 7.6 * DEG / 3600, 1.8 * DEG / 3600
LEVELS = (2.0, 2.71, 4.0, 5.41, 6.63, 8.0, 10.0)


def columns(n):
    """Density of the ordinates of a DCT-II of n samples per squared N, B, K, (n - 1, 3)."""
    k = np.arange(1, n)
    s = 2 * np.sin(np.pi * k / (2 * n))
    return np.stack([np.ones(n - 1), DT / s * (1 - 2 / (np.pi**2 * k)), DT**2 / s**2], axis=1)


def bound(x):
    """Standard errors of N, B and K in %, from the Fisher information of their squares."""
    squares = np.square([N, B, K])
    rows = x / (x @ squares)[:, None]
    return 50 * np.sqrt(np.diagonal(np.linalg.inv(0.5 * rows.T @ rows))) / squares


def estimates(power, records, rng):
    x = columns(2**power)
    edges = np.unique(np.concatenate([np.arange(65), np.rint(np.geomspace(64, len(x), 220)).astype(int)]))
    count = np.diff(edges).astype(float)

    def binned(values):
        return np.add.reduceat(values, edges[:-1], axis=-1) / count

    errors = bound(x)
    print(f"\n2^{power} samples: bound of N, B, K {errors[0]:.2f}, {errors[1]:.1f}, {errors[2]:.1f} %; {records} records")
    grids = (N * (1 + 0.01 * errors[0] * np.linspace(-3.2, 3.2, 9)), B * np.linspace(0, 2, 61), K * np.linspace(0, 4, 161))
    s = np.stack([one.ravel() for one in np.meshgrid(*grids, indexing="ij")], axis=1) ** 2 @ binned(x.T)
    ratio, constant = count / s, (count * np.log(s)).sum(axis=1)

    def likelihoods(k, size=100):
        """Log likelihoods of records at the nodes of the grid, over that of the best node."""
        level = x @ np.square([N, B, k])
        for _ in range(records // size):
            drawn = np.array([binned(level * rng.standard_normal(len(x)) ** 2) for _ in range(size)])
            found = -0.5 * (constant + drawn @ ratio.T)
            yield (found - found.max(axis=1, keepdims=True)).reshape(size, *map(len, grids))

    values, rise = {}, []
    b, k = grids[1], grids[2]
    priors = {"flat in B, K": (b**0, k**0), "flat in the squares": (b, k), "1/B, 1/K": (1 / (b + B / 50), 1 / (k + K / 50))}
    for found in likelihoods(K):
        best = found.max(axis=(1, 2))
        rise.append(2 * (best.max(axis=1) - best[:, 0]))
        values.setdefault("maximum of the likelihood", []).append(k[best.argmax(axis=1)])
        likelihood = np.exp(found).sum(axis=1)
        for name, (prior_b, prior_k) in priors.items():
            posterior = np.einsum("rbk,b->rk", likelihood, prior_b) * prior_k
            posterior /= posterior.sum(axis=1, keepdims=True)
            median = k[np.argmax(posterior.cumsum(axis=1) >= 0.5, axis=1)]
            for what, value in (("mean", posterior @ k), ("median", median), ("mode", k[posterior.argmax(axis=1)])):
                values.setdefault(f"posterior {what}, {name}", []).append(value)
    for name, value in values.items():
        off = 100 * (np.concatenate(value) / K - 1)
        rmse = np.sqrt(np.mean(off**2))
        print(f"{name:40s} bias {off.mean():5.1f}   rmse {rmse:5.2f} +- {np.std(off**2) / (2 * rmse * np.sqrt(len(off))):.2f}")
    absent = np.concatenate([2 * (best.max(axis=1) - best[:, 0]) for best in (found.max(axis=(1, 2)) for found in likelihoods(0.0))])
    rise = np.concatenate(rise)
    for level in LEVELS:
        print(
            f"level {level:5.2f}: K present in {100 * np.mean(rise > level):5.1f} %, falsely in {100 * np.mean(absent > level):5.2f} %",
            flush=True,
        )


def event(records, rng, ordinates=256, blocks=4096):
    n = 2**17
    x, length = columns(n)[:ordinates], n * DT
    t = (np.arange(blocks) + 0.5) * length / blocks

    def spectra(y):
        return scipy.fft.dct(y, norm="ortho", axis=-1)[..., 1 : ordinates + 1] * np.sqrt(length / blocks)

    size = 60 * DEG / 3600
    starts, times = length * np.arange(1, 64) / 64, length * 2.0 ** np.arange(-7, 1)
    shapes = np.array([1 - np.exp(-np.maximum(t - start, 0) / time) for start in starts for time in times])
    shapes = spectra(shapes / shapes[:, -1:])
    truth = size * spectra(-np.expm1(-np.maximum(t - length / 2, 0) / 250))
    bs, ks = B * np.linspace(0.3, 1.8, 16), K * np.exp(np.linspace(np.log(0.3), np.log(3), 16))

    def normal(y, level):
        return -0.5 * np.sum(np.log(level) + y**2 / level)

    def statistics(y):
        """(log Bayes factor, log ratio of the maxima) of an event without K over K without an event."""
        walks = np.array([normal(y, x @ np.square([N, b, k])) for b in bs for k in ks])
        marginal, largest = [], []
        for b in bs:
            level = x @ np.square([N, b, 0.0])
            precision, score = (shapes**2 / level).sum(axis=1), (shapes * y / level).sum(axis=1)
            spread = 1 / (precision + 1 / size**2)
            marginal.append(normal(y, level) + logsumexp(0.5 * score**2 * spread + 0.5 * np.log(spread / size**2)) - np.log(len(shapes)))
            largest.append(normal(y, level) + 0.5 * np.max(score**2 / precision))
        return logsumexp(marginal) - np.log(len(bs)) - logsumexp(walks) + np.log(len(walks)), max(largest) - walks.max()

    def drawn(k):
        return np.sqrt(x @ np.square([N, B, k])) * rng.standard_normal(ordinates)

    walks, events = (np.array([statistics(make()) for _ in range(records)]) for make in (lambda: drawn(K), lambda: truth + drawn(0.0)))
    print(f"\nevent or K, {records} records of each")
    for i, name in enumerate(("Bayes factor", "ratio of the maxima")):
        cells = (
            f"{share} % silent: {100 * np.mean(walks[:, i] > np.percentile(events[:, i], share)):.0f} % needless" for share in (3, 5, 10)
        )
        print(f"{name:20s} " + ", ".join(cells), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=3000)
    parser.add_argument("--powers", default="17,19")
    options = parser.parse_args()
    for power in options.powers.split(","):
        estimates(int(power), options.records, np.random.default_rng([5, int(power)]))
    event(options.records // 6, np.random.default_rng(7))
