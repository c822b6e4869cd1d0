"""The fitted leaves of a model object, and how corrected fields change with them."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._types import Array
from ._ellipsoid._kinds import PLACE
from ._model import MagModel


class Leaves(eqx.Module):
    """The fitted leaves: six entries of S, and the model without its soft iron."""

    soft_iron: Any
    rest: MagModel

    def model(self, turn: Any) -> MagModel:
        """The model with soft iron S Q."""
        return eqx.tree_at(lambda m: m.soft_iron, self.rest, self.soft_iron[PLACE] @ turn, is_leaf=lambda leaf: leaf is None)


def changes(model: MagModel, field: Any, usual: dict[str, Any], directions: Any) -> Array:
    """Derivative (n, 3, p) of corrected unit fields by hard iron, soft iron, the field (zero) and further leaves, in usual conditions."""
    there = {name: jnp.broadcast_to(value, (len(directions), *jnp.shape(value))) for name, value in usual.items()}
    readings = model.measure(field * jnp.asarray(directions), **there)
    slope = jax.jacfwd(lambda model: model.correct(readings, **there))(model)
    soft, hard, *further = (x.reshape(*readings.shape, -1) for x in jax.tree.leaves(slope))
    return jnp.concatenate([hard, soft, jnp.zeros_like(soft[..., :1]), *further], axis=-1) / field


_compiled = filter_jit(changes)


def changes_of(model: Any, field: Any, usual: dict[str, Any], directions: np.ndarray) -> np.ndarray:
    """`changes` for a fitted model object (host only)."""
    return np.asarray(_compiled(jax.tree.map(jnp.asarray, model), field, usual, directions))
