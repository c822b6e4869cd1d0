"""Chains of nuisance unknowns against one dense matrix."""

import itertools

import numpy as np

from jaxcal.fitting import Chain


def test_a_chain_is_solved_as_one_matrix_is():
    rng = np.random.default_rng(0)
    count, size, width = 7, 3, 4
    own, both = rng.normal(size=(count, 5, size + width)), rng.normal(size=(count - 1, 6, 2 * size + width))
    rows = []
    for k in range(count):
        row = np.zeros((5, count * size + width))
        row[:, k * size : (k + 1) * size], row[:, count * size :] = own[k, :, :size], own[k, :, size:]
        rows.append(row)
    for k in range(count - 1):
        row = np.zeros((6, count * size + width))
        row[:, k * size : (k + 2) * size], row[:, count * size :] = both[k, :, : 2 * size], both[k, :, 2 * size :]
        rows.append(row)
    jacobian = np.concatenate(rows)
    residual = rng.normal(size=len(jacobian))
    normal, score = jacobian.T @ jacobian, jacobian.T @ residual
    n = count * size
    at = [slice(k * size, (k + 1) * size) for k in range(count)]
    chain = Chain(
        np.array([normal[a, a] for a in at]), np.array([normal[a, b] for a, b in itertools.pairwise(at)]),
        np.array([normal[a, n:] for a in at]), normal[n:, n:], score[:n].reshape(count, size), score[n:],
    )  # fmt: skip
    found = chain.eliminated()
    step = -np.linalg.solve(found.information, found.score)
    whole = -np.linalg.solve(normal, score)
    np.testing.assert_allclose(np.concatenate([found.links(step).ravel(), step]), whole, rtol=1e-9)
    inverse = np.linalg.inv(normal)
    np.testing.assert_allclose(np.linalg.inv(found.information), inverse[n:, n:], rtol=1e-9)
    variances = chain.variances(inverse[n:, n:], found.carried)
    np.testing.assert_allclose(variances, np.array([inverse[a, a] for a in at]), rtol=1e-8)
    # steps for other right-hand sides
    link_scores, scores = rng.normal(size=(count, size, 2)), rng.normal(size=(width, 2))
    links, steps = chain.steps(link_scores, scores)
    expected = -np.linalg.solve(normal, np.concatenate([link_scores.reshape(n, 2), scores]))
    np.testing.assert_allclose(np.concatenate([links.reshape(n, 2), steps]), expected, rtol=1e-8)
