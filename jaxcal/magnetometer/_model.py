"""`MagModel`: converts a true field to readings, and readings to fields; and what it, or a subclass with fields of its own, says of
readings, with all derivatives.
"""

import functools
from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import DataError
from .._frozen import Model
from .._jax import ROUGH
from .._precision import array_module, host_float64, is_traced
from .._types import AnyArray, Array, Held, Samples
from .._units import BEYOND
from ..fitting._problem import names_of
from ._orthogonal import Near, inverted, nearest, times

#: names of the entries of the hard iron, and of the soft iron
HARD = tuple(f"hard_iron[{i}]" for i, _ in enumerate("xyz"))
SOFT = tuple(f"soft_iron[{i},{j}]" for i, _ in enumerate("xyz") for j, _ in enumerate("xyz"))

ROWS = 512  # of a block: readings and directions of any number share one program
_UNDONE = 1e-6  # relative error of a reading after `correct` and `measure`: far below the noise of any sensor


class MagModel(Model):
    r"""Soft iron and hard iron of a magnetometer.

    .. math:: m = C h + b

    Attributes
    ----------
    soft_iron : (3, 3) distortion C: reading per field. The identity matrix means no distortion.
    hard_iron : (3,) offset b, in the unit of the readings.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> model = jaxcal.magnetometer.MagModel(np.diag([1.1, 1.0, 0.9]), np.array([3e-6, -1e-6, 0.0]))
    >>> reading = model.measure(np.array([20e-6, 0.0, 40e-6]))
    >>> print((1e6 * reading).round(3), (1e6 * model.correct(reading)).round(3))
    [25. -1. 36.] [20.  0. 40.]

    References
    ----------
    The magnetometer paper's equations (1) to (5), as one matrix and one vector.
    """

    soft_iron: Held
    hard_iron: Held

    def __init_subclass__(cls, **options: Any) -> None:
        """Make `measure` and `correct` of a subclass run in float64 on the host, as they do here."""
        super().__init_subclass__(**options)
        for name in ("measure", "correct"):
            if name in vars(cls):
                setattr(cls, name, host_float64(_undoing(vars(cls)[name]) if name == "correct" else vars(cls)[name]))

    @host_float64
    def measure(self, h: Samples) -> AnyArray:
        """Readings C h + b in the true fields `h` (3,) or (n, 3), in the unit of the hard iron."""
        xp, (field, matrix, offset) = _same_dtype(h, self.soft_iron, self.hard_iron)
        return field @ matrix.T + xp.broadcast_to(offset, field.shape)

    @host_float64
    def correct(self, m: Samples) -> AnyArray:
        """Fields C^-1 (m - b) that belong to the readings `m` (3,) or (n, 3), in the same unit, because C has no unit."""
        xp, (reading, matrix, offset) = _same_dtype(m, self.soft_iron, self.hard_iron)
        return (reading - xp.broadcast_to(offset, reading.shape)) @ xp.linalg.inv(matrix).T


def _undoing(correct: Any) -> Any:
    """A `correct` that is refused where `measure` does not give the readings back."""

    @functools.wraps(correct)
    def checked(model: Any, m: Any, *args: Any, **conditions: Any) -> Any:
        h = correct(model, m, *args, **conditions)
        if not is_traced(model, m, h):
            off, size = np.asarray(model.measure(h, *args, **conditions)) - m, np.asarray(m) - model.hard_iron
            if np.nansum(off**2) > _UNDONE**2 * np.nansum(size**2):
                raise DataError(f"`correct` of {type(model).__name__} must be the inverse of its `measure`.", code="no_inverse")
        return h

    return checked


def _same_dtype(*values: Any) -> tuple[ModuleType, list[Any]]:
    """`numpy`, or `jax.numpy` if something is traced; and the values as its arrays, of the widest floating type among them."""
    xp = array_module(values)
    kind = np.result_type(*(value.dtype if hasattr(value, "dtype") else np.dtype(float) for value in values), np.float32)
    return xp, [xp.asarray(value, dtype=kind if xp is np else jax.dtypes.canonicalize_dtype(kind)) for value in values]


def quantity_of(size: Any) -> str:
    """Quantity of readings of this size: "mag" for a field in tesla, else "counts"; "ratio" where it is traced."""
    return "ratio" if isinstance(size, jax.Array) else "mag" if size < BEYOND["mag"] else "counts"


def parts_of(model: MagModel) -> tuple[Any, list[str], Callable[[Any], MagModel]]:
    """The leaves as one vector (soft iron by rows, hard iron, further ones), the names of further ones, and the model of other leaves."""
    leaves, structure = jax.tree.flatten(model)
    ends, xp = np.cumsum([leaf.size for leaf in leaves]).tolist(), np if all(isinstance(leaf, np.ndarray) for leaf in leaves) else jnp

    def put(values: Any) -> MagModel:
        parts = [values[end - leaf.size : end].reshape(leaf.shape) for leaf, end in zip(leaves, ends, strict=True)]
        return jax.tree.unflatten(structure, parts)

    return xp.concatenate([leaf.ravel() for leaf in leaves]), names_of(model)[12:], put


# it runs so shortly that it is compiled without optimisation, in half the time
@functools.partial(filter_jit, further=ROUGH)
def _looked(model: MagModel, leaves: Any, h: Any, field: Any, conditions: Any) -> tuple[Any, ...]:
    """Readings of the unit fields h, and their derivatives (n, 3, 3) by h and (n, 3, p) by the leaves."""
    put = parts_of(model)[2]

    def along(way: Any) -> tuple[Any, Any]:
        change = way[: leaves.size], jnp.broadcast_to(way[leaves.size :], h.shape)
        return jax.jvp(lambda leaves, h: put(leaves).measure(field * h, **conditions), (leaves, h), change)

    measured, slopes = jax.vmap(along, out_axes=(None, -1))(jnp.eye(leaves.size + 3, dtype=h.dtype))
    return measured, slopes[..., leaves.size :], slopes[..., : leaves.size]


def looked(model: MagModel, leaves: Any, h: Any, field: Any, conditions: Any) -> tuple[Any, ...]:
    """`_looked`, on the host in blocks of one length."""
    if isinstance(h, jax.Array):
        return _looked(model, leaves, h, field, conditions)
    blocks = []
    for first in range(0, len(h), ROWS):
        rows = np.minimum(np.arange(first, first + ROWS), len(h) - 1)
        there = {name: values[rows] for name, values in conditions.items()}
        blocks.append([np.asarray(part) for part in _looked(model, leaves, h[rows], np.float64(field), there)])
    return tuple(np.concatenate(parts)[: len(h)] for parts in zip(*blocks, strict=True))


class Measured(NamedTuple):
    """The surfaces of a model object, for readings (n, 3), as `Ellipsoids` are those of a kind.

    model : its structure. data : readings, magnitude of the field, conditions, and the leaves by the parameters (S, hard iron, further).
    """

    model: MagModel
    data: tuple[Any, ...]
    kind: str
    basis: Any
    size: Any

    def near(self, x: Any, near: Near, m: Any, norm: Any, conditions: Any, to_leaves: Any) -> Near:
        """Readings beside the surface of parameters x, by what the model says of the fields of readings beside one not far away."""
        measured, push, slopes = looked(self.model, to_leaves @ x, near.field, norm, conditions)
        near = nearest(push, m - measured + times(near.field, push.swapaxes(1, 2)), near.multiplier)
        return near._replace(slopes=-x.__array_namespace__().einsum("ni,nij->nj", near.normal, slopes) @ to_leaves)

    def settled(self, x: Any, near: Near, *data: Any) -> Near:
        """`near` with derivatives: the model looks again where the first look ends, and sees the fields change with the parameters."""
        return self.near(x, self.near(x, near, *data), *data)


@host_float64
def changes_of(model: MagModel, field: Any, usual: dict[str, Any], across: Any, directions: Any) -> Any:
    """Change (n, p) of corrected unit fields, along vectors, by hard iron, soft iron, the field (zero) and further leaves.

    In usual conditions.
    """
    xp = model.soft_iron.__array_namespace__()
    directions = xp.asarray(directions, dtype=model.soft_iron.dtype)
    there = {name: xp.broadcast_to(value, (len(directions), *np.shape(value))) for name, value in usual.items()}
    _, push, slopes = looked(model, parts_of(model)[0], directions, field, there)
    change = -xp.einsum("ni,nij,njp->np", across, inverted(push), slopes)
    return xp.concatenate([change[:, 9:12], change[:, :9], 0.0 * change[:, :1], change[:, 12:]], axis=1)


def residuals(model: MagModel, data: tuple[Any, ...]) -> Array:
    r"""Signed orthogonal distance of each reading to the surface of all readings that a field of magnitude H can give.

    .. math:: d_i = \pm\min_h |m_i - \mathrm{measure}(h)|,\qquad |h| = H

    These are the residuals of maximum likelihood for white noise of one variance in all axes, for any unknown attitudes.

    Parameters
    ----------
    model : a `MagModel`, or a subclass with `measure(h, **conditions)` and `correct(m, **conditions)`.
    data : (m, H) or (m, H, conditions): readings (n, 3), the magnitude of the field in their unit, and a dictionary of arrays with one row
        per reading, such as the temperature.

    Returns
    -------
    (n,) in the unit of the readings, positive outside. Works under `jit`, `grad` and `vmap`.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.magnetometer import MagModel, residuals
    >>> model = MagModel(jnp.diag(jnp.array([1.0, 2.0, 1.0])), jnp.zeros(3))
    >>> print(residuals(model, (jnp.array([[0.0, 11.0, 0.0], [4.0, 0.0, 0.0]]), 5.0)).round(3))
    [ 1. -1.]

    References
    ----------
    N. I. Chernov and H. Ma, Least squares fitting of quadratic curves and surfaces, 2011, section 5 (the nearest point).
    """
    m, field, *conditions = data
    return _residuals(*jax.tree.map(jnp.asarray, (model, m, field, conditions[0] if conditions else {})))


@filter_jit
def _residuals(model: MagModel, m: Any, field: Any, conditions: Any) -> Array:
    # one program: called by themselves, its two hundred operations would be compiled one by one
    h = jnp.asarray(model.correct(m, **conditions)) / field
    measured, push, _ = looked(model, parts_of(model)[0], h, field, conditions)
    return nearest(push, m - measured + times(h, push.swapaxes(1, 2))).distance
