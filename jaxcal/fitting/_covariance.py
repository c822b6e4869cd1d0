"""Covariance of fitted parameters: from the model, from a sandwich over blocks of residuals, or from refits without one block at a time."""

import dataclasses
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._compile import filter_jit
from .._errors import FitError
from .._precision import array_module, is_traced
from .._types import AnyArray, Array, Value
from ._information import Information, information as information_of
from ._problem import Problem
from ._result import Fit, Outcome, ended, known_of, to_numpy, weighted_rows
from ._search import search
from ._serial import BLOCKS

Kind = Literal["model", "sandwich", "jackknife"]


def covariance(fit: Fit[Any], kind: Kind = "model", *, blocks: int | AnyArray | None = None, scaled: bool = False) -> AnyArray:
    """Covariance of the parameters of a fit.

    With J the Jacobian of the residuals, K that of the priors and B = (J'J + K'K)^-1:

    - "model" assumes independent residuals with standard deviation one: C = B. With `scaled` the residuals share one unknown variance,
      estimated by the reduced chi-square s^2: C = B (s^2 J'J + K'K) B. A robust loss is always scaled, and corrected for the finite number
      of residuals (Huber and Ronchetti, Robust Statistics, 2009, section 7.6).
    - "sandwich" allows residuals of any variance that are correlated within a block: C = B (sum_b g_b g_b' + K'K) B, where g_b is the
      gradient of block b, corrected for the leverage of the block (R. M. Bell and D. F. McCaffrey, Survey Methodology 28 (2002) 169).
    - "jackknife" refits without one block at a time: C = (m - 1) / m sum_b (x_b - mean) (x_b - mean)' + B K'K B with m blocks. It also
      includes the curvature of the model, and the fact that parts of a recording determine different parameters. Use it for real sensors,
      whose errors are correlated in time: "model" then gives errors several times too small. It needs a fit by `solve`.

    The residuals of priors are independent with variance one. They are never scaled, and they belong to no block.

    Parameters
    ----------
    fit
        A fit. A parameter at its bound counts as fixed and has zero covariance, except with "jackknife", where it may leave the bound.
    kind
        "model", "sandwich" or "jackknife".
    blocks
        Blocks of residuals: a number of contiguous blocks in the order of `fit.residuals` (without padding), or (n,) labels. By
        default six blocks for "jackknife", and one block per residual for "sandwich".
    scaled
        For "model": multiply by the reduced chi-square. Use it if the standard deviation of the residuals is unknown.

    Returns
    -------
    (p, p) in the units of the parameters; infinite if the data do not determine every parameter, with all blocks or without one of them.

    Raises
    ------
    FitError
        If the labels are not one per residual, blocks are too few, `kind` takes no blocks, or a jackknife lacks the data of its fit.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import covariance, solve
    >>> fit = solve(lambda mean, y: (mean - y) / 2, 0.0, jnp.array([1.0, 5.0, 3.0, 3.0]))
    >>> float(covariance(fit)[0, 0].round(6))
    1.0
    >>> float(covariance(fit, "jackknife", blocks=4)[0, 0].round(6))
    0.666667
    """
    xp = array_module(fit.residuals)
    known = _bread(fit)
    root = known.root
    bread = root @ root.T
    prior = fit.prior_jacobian.T @ fit.prior_jacobian
    if kind == "model":
        if blocks is not None:
            raise FitError("The covariance of the model takes no blocks; leave them out, or give another kind.", code="no_blocks")
        factor = _variance(fit) if scaled or fit.robust else 1
        matrix = factor * bread + (1 - factor) * (bread @ prior @ bread)
    elif kind == "sandwich":
        matrix = bread @ (_meat(fit, *_labels(fit, blocks)) + prior) @ bread
    elif kind == "jackknife":
        if fit.problem is None:
            raise FitError("A fit out of many does not keep its data; solve it by itself for a jackknife.", code="no_data")
        labels, count = _labels(fit, BLOCKS if blocks is None else blocks)
        matrix = _refits(fit, fit.problem, labels, count) + bread @ prior @ bread
    else:
        raise FitError(f"There is no covariance of kind {kind!r}; the kinds are 'model', 'sandwich' and 'jackknife'.", code="kind")
    lost = xp.logical_or(known.rank < xp.sum(~fit.at_bound), ended(fit, Outcome.unidentifiable))
    return xp.where(lost, np.inf, matrix)


def intervals(
    fit: Fit[Any], kind: Kind = "model", *, confidence: float = 0.95, blocks: int | AnyArray | None = None, **options: Any
) -> AnyArray:
    """Intervals of the parameters: the estimate plus and minus a quantile times its standard error (host only).

    The quantile is from Student's t distribution with the degrees of freedom of the variance: m - 1 for a sandwich or jackknife with m
    blocks, and `fit.degrees_of_freedom` for a scaled covariance or a robust loss. For a covariance of kind "model" without scaling it is
    from the normal distribution.

    Parameters
    ----------
    fit, kind, blocks
        As for `covariance`.
    confidence
        Probability that an interval covers its parameter.
    options
        Further options of `covariance`.

    Returns
    -------
    (p, 2) lower and upper ends in the order of `fit.names`, in the units of the parameters. The interval of a parameter at its bound has
    zero length.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import intervals, solve
    >>> fit = solve(lambda mean, y: (mean - y) / 2, 0.0, jnp.array([1.0, 5.0, 3.0, 3.0]))
    >>> print(intervals(fit).round(2), intervals(fit, "jackknife", blocks=4).round(2))
    [[1.04 4.96]] [[0.4 5.6]]
    """
    error = np.sqrt(np.diagonal(np.asarray(covariance(fit, kind, blocks=blocks, **options))))
    if kind == "model":
        freedom = float(fit.degrees_of_freedom) if fit.robust or options.get("scaled") else np.inf
    else:
        labels, _ = _labels(fit, BLOCKS if kind == "jackknife" and blocks is None else blocks)
        freedom = _real(fit, labels) - 1
    reach = scipy.special.stdtrit(freedom, (1 + confidence) / 2) * error
    return np.asarray(fit.parameters)[:, None] + reach[:, None] * np.array([-1.0, 1.0])


def _bread(fit: Fit[Any]) -> Information:
    """Inverse of the curvature of the cost, with the mean curvature of the loss."""
    if not fit.robust:
        return known_of(fit)
    xp = array_module(fit.residuals)
    rows = xp.sqrt(xp.abs(fit.mean_curvature)) * fit.jacobian
    return information_of(xp.concatenate([rows, fit.prior_jacobian]), held=fit.at_bound)


def _variance(fit: Fit[Any]) -> Value:
    """Factor for the data's share of the covariance: the reduced chi-square, or its counterpart for a robust loss."""
    if not fit.robust:
        return fit.variance
    xp = array_module(fit.residuals)
    relative = xp.sum(xp.where(fit.counted, (fit.curvature / fit.mean_curvature - 1) ** 2, 0)) / fit.count
    return (1 + fit.effective / fit.count * relative) ** 2 * fit.variance * fit.mean_curvature


def _labels(fit: Fit[Any], blocks: int | AnyArray | None) -> tuple[AnyArray, int]:
    """Block number of every residual, and the number of blocks."""
    xp, n = array_module(fit.residuals), fit.residuals.size
    if isinstance(blocks, int):
        if not 2 <= blocks <= n:
            raise FitError(f"{blocks} blocks were asked for; give at least 2, and at most one per residual ({n}).", code="blocks")
        place = xp.cumsum(fit.counted) - 1
        return xp.clip(place * blocks // xp.maximum(place[-1] + 1, 1), 0, blocks - 1), blocks
    labels = np.arange(n) if blocks is None else np.asarray(blocks)
    if labels.shape != fit.residuals.shape:
        raise FitError(f"The labels of the blocks have shape {labels.shape}; give one per residual, {fit.residuals.shape}.", code="labels")
    found, number = np.unique(labels, return_inverse=True)
    return number, len(found)


def _real(fit: Fit[Any], labels: AnyArray) -> int:
    """Number of blocks that contain more than padding (host only)."""
    return len(np.unique(np.asarray(labels)[np.asarray(fit.counted)]))


def _meat(fit: Fit[Any], labels: AnyArray, count: int) -> AnyArray:
    """Sum of the squared gradients of the blocks, each corrected for its leverage H_b: J_b' (1 - H_b)^-1/2 r_b in p dimensions."""
    xp, rows = array_module(fit.residuals), weighted_rows(fit)[0]
    if not is_traced(fit.residuals):
        real = _real(fit, labels)
        if real <= fit.free:
            raise FitError(f"{real} blocks are too few for {int(fit.free)} parameters; record more, or use finer ones.", code="few_blocks")
    root = known_of(fit).root
    share = rows @ root
    hat, score = (
        jax.ops.segment_sum(part, labels, num_segments=count)
        for part in (share[:, :, None] * share[:, None, :], share * (xp.sqrt(fit.weights) * fit.residuals)[:, None])
    )
    values, vectors = xp.linalg.eigh(xp.eye(root.shape[0], dtype=rows.dtype)[None] - hat)
    # a block of leverage one leaves no residual to scale
    score = xp.einsum("bij,bj->bi", xp.swapaxes(vectors, 1, 2), score) / xp.sqrt(xp.maximum(values, xp.finfo(rows.dtype).eps ** 0.5))
    score = xp.einsum("bij,bj->bi", vectors, score)
    score = score @ (rows.T @ share + fit.prior_jacobian.T @ (fit.prior_jacobian @ root)).T
    return score.T @ score


@filter_jit
def _without(problem: Problem, keep: Array) -> tuple[Array, Array]:
    """Parameters of the refits, (m, p), and whether each refit converged and is determined."""

    def refit(kept: Array) -> tuple[Array, Array]:
        found = search(dataclasses.replace(problem, keep=kept))
        r = found.rows.residuals
        weight = jnp.ones_like(r) if problem.loss is None else problem.loss.weight(r)
        rows = jnp.concatenate([jnp.sqrt(weight)[:, None] * found.rows.jacobian, found.rows.prior_jacobian])
        rank = information_of(jax.lax.stop_gradient(rows), held=found.held).rank
        return found.x, found.flat & (rank == jnp.sum(~found.held)) & jnp.all(jnp.isfinite(found.x))

    return jax.lax.map(refit, keep)


def _refits(fit: Fit[Any], problem: Problem, labels: AnyArray, count: int) -> AnyArray:
    """Jackknife covariance: (m - 1) / m times the sum of squares of the refits' deviations from their mean, for m blocks.

    Every refit starts at the solution. Blocks that contain only padding are ignored. The result is infinite if a refit fails.
    """
    xp = array_module(fit.residuals)
    problem = dataclasses.replace(problem, start=fit.model, starts=None)
    out = labels[None, :] == xp.arange(count)[:, None]
    x, usable = to_numpy(_without(problem, jnp.asarray(~out)))
    real = xp.any(out & xp.asarray(fit.counted)[None, :], axis=1)
    m = xp.sum(real, dtype=x.dtype)
    mean = xp.sum(xp.where(real[:, None], x, 0), axis=0) / m
    deviation = xp.where(real[:, None], x - mean[None, :], 0)
    return xp.where(xp.all(usable | ~real) & (m > 1), (m - 1) / m * (deviation.T @ deviation), xp.inf)
