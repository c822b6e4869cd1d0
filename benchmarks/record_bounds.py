"""What the best possible estimate and verdict reach on the records of `records.py`, without `jaxcal.noise`.

`observed_bound`: standard errors of the coefficients of a record with missing samples, by its Fisher information. That of a complete
record is known. Less of it is the part that the missing samples hold (T. A. Louis, J. R. Stat. Soc. B 44, 1982): the covariance of the
complete score given the samples observed, which is half that of the difference between the scores of two records that agree there.

`neyman_pearson`: power of the most powerful test between two densities that are both known; no verdict has more. `ratios`: likelihood
ratios where the coefficients of both are estimated.
"""

import numpy as np
import scipy.fft
import scipy.optimize


def _score(x, columns, density, dt):
    """Score of the squared coefficients of a complete record (n,)."""
    ordinates = dt * scipy.fft.dct(x, norm="ortho")[1:] ** 2
    return 0.5 * columns.T @ ((ordinates / density - 1.0) / density)


def _redrawn(x, missing, density, dt, rng):
    """The record with its missing samples drawn anew, given the others; its mean is free."""
    precision = np.concatenate([[0.0], dt / density])
    where, full = np.flatnonzero(missing), np.zeros(len(x))

    def product(v):
        full[where] = v
        return scipy.fft.idct(precision * scipy.fft.dct(full, norm="ortho"), norm="ortho")[where]

    known = np.where(missing, 0.0, x - x[~missing].mean())
    white = np.sqrt(precision) * rng.standard_normal(len(x))
    b = scipy.fft.idct(white - precision * scipy.fft.dct(known, norm="ortho"), norm="ortho")[where]
    v, r = np.zeros_like(b), b.copy()
    direction, size = r, r @ r
    least = 1e-8 * size
    while size > least:  # conjugate gradients
        image = product(direction)
        step = size / (direction @ image)
        v, r = v + step * direction, r - step * image
        size, last = r @ r, size
        direction = r + size / last * direction
    known[where] = v
    return known


def information_lost(columns, squares, lose, runs, dt, seed):
    """(runs, p, p) parts of the information of squared coefficients that missing samples hold; their mean estimates it.

    `lose` maps a generator to the mask of the missing samples, (n,).
    """
    density, parts = columns @ squares, []
    for i in range(runs):
        rng = np.random.default_rng([seed, i])
        ordinates = np.sqrt(density / dt) * rng.standard_normal(len(density))
        x = scipy.fft.idct(np.concatenate([[0.0], ordinates]), norm="ortho")
        difference = _score(x, columns, density, dt) - _score(_redrawn(x, lose(rng), density, dt, rng), columns, density, dt)
        parts.append(0.5 * np.outer(difference, difference))
    return np.array(parts)


def complete_information(columns, squares):
    """Information of squared coefficients in a complete record."""
    rows = columns / (columns @ squares)[:, None]
    return 0.5 * rows.T @ rows


def relative_bound(information, squares):
    """Least standard error of each coefficient over its value, where one that is zero must be estimated too, and is not below it.

    The estimate of the zero coefficient is positive in half of the records, and zero in the others: then the rest is as well known as
    without it. The mean square of both bounds is that of the estimate that has this limit.
    """
    there = squares > 0.0
    with_it = np.diag(np.linalg.inv(information))[there]
    without_it = np.diag(np.linalg.inv(information[np.ix_(there, there)]))
    return np.sqrt((with_it + without_it) / 2.0) / (2.0 * squares[there])


def likeliest(ordinates, columns, count):
    """-2 log likelihood and density of the likeliest sum of columns, none negative, for means of `count` ordinates.

    For a density in place of ordinates it is the sum of columns from which it takes most records to tell that density.
    """

    def cost(logs):
        s = columns @ np.exp(logs)
        return np.sum(count * (ordinates / s + np.log(s))), np.exp(logs) * (columns.T @ (count * (1.0 - ordinates / s) / s))

    slow = columns.shape[1] - 1
    level = np.append(np.mean(ordinates[-4:]), np.mean(ordinates[:8]) / columns[:8, 1:].mean(axis=0))
    starts = [level * np.append(1.0, np.where(np.arange(slow) == faint, 1e-3, 0.5)) for faint in range(-1, slow)]
    bounds = [(-40.0, 25.0)] * (slow + 1)
    tried = [scipy.optimize.minimize(cost, np.log(start), jac=True, method="L-BFGS-B", bounds=bounds) for start in starts]
    best = min(tried, key=lambda one: one.fun)
    return best.fun, columns @ np.exp(best.x)


def neyman_pearson(density, other, count, level, runs=40_000, seed=0):
    """Power at a density of the most powerful test against another one, of a false positive in a share `level`."""
    drawn = np.random.default_rng(seed).gamma(count / 2, 2 / count, size=(runs, len(count)))
    likelihood = [drawn * true @ (count * (1.0 / other - 1.0 / density)) for true in (other, density)]
    return float(np.mean(likelihood[1] > np.quantile(likelihood[0], 1.0 - level)))


def ratios(density, own, rivals, count, runs, seed=0):
    """(runs,) twice the log likelihood of the likeliest sum of columns `own` over that of the likeliest rival, for records of a density."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(runs):
        drawn = density * rng.gamma(count / 2, 2 / count)
        found.append(min(likeliest(drawn, columns, count)[0] for columns in rivals) - likeliest(drawn, own, count)[0])
    return np.array(found)
