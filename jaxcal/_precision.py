"""Float64 for host functions, without changing the user's JAX configuration."""

import functools
import inspect
import os
import threading
import warnings
from collections.abc import Callable
from types import ModuleType
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from ._errors import DataError, PrecisionWarning
from ._jax import QUICK, has_started, is_traced as is_traced, quickly, setting


class _Fork:
    """Whether this process was forked from one in which JAX had started: JAX's threads are missing, and programs would wait for ever."""

    severed = False

    @classmethod
    def cut(cls) -> None:
        """Set the flag in the child of a fork."""
        cls.severed = cls.severed or has_started()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_Fork.cut)

#: beyond the range of any sensor in any unit, and squares of its ratios overflow
LARGEST = 1e30

F = TypeVar("F", bound=Callable[..., Any])


def array_module(*trees: Any) -> ModuleType:
    """`jax.numpy` if something is traced, otherwise `numpy`.

    NumPy computes a closed form over a few hundred values in less time than JAX needs to look up its first operation, and with JAX each
    new shape would cost one compilation per operation.
    """
    return jnp if is_traced(*trees) else np


def map_ordered(function: Callable[..., Any], tree: Any, *rest: Any) -> Any:
    """`jax.tree.map` that keeps the order of dictionaries, which JAX sorts by key."""

    def one(leaf: Any, *others: Any) -> Any:
        if type(leaf) is dict:
            return {key: map_ordered(function, value, *(other[key] for other in others)) for key, value in leaf.items()}
        return function(leaf, *others)

    return jax.tree.map(one, tree, *rest, is_leaf=lambda node: type(node) is dict)


class _Call:
    """Arguments of a traced call without the tracers; two calls are equal if they trace the same program."""

    def __init__(self, args: tuple[Any, ...], kwargs: dict[str, Any]):
        self.tracers: list[Tracer] = []

        def taken(leaf: Any) -> Any:
            if isinstance(leaf, Tracer):
                self.tracers.append(leaf)
            return Tracer if isinstance(leaf, Tracer) else leaf

        self._still = map_ordered(taken, (args, kwargs))
        leaves, structure = jax.tree.flatten(self._still)
        traced = [(leaf.shape, leaf.dtype) for leaf in self.tracers], setting("jax_enable_x64")
        self._key = structure, tuple(map(_known_by, leaves)), str(traced)

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Call) and self._key == other._key

    def arguments(self, tracers: list[Any]) -> Any:
        following = iter(tracers)
        return map_ordered(lambda leaf: next(following) if leaf is Tracer else leaf, self._still)


def _known_by(leaf: Any) -> Any:
    """What tells a leaf from others: type and value, of an array its bytes."""
    if isinstance(leaf, np.ndarray | jax.Array):
        array = np.asarray(leaf)
        return array.dtype, array.shape, array.tobytes()
    return type(leaf), leaf


class _Program:
    """A traced function as one program of its tracers, whose derivative is a second one; both compile in half the time on a CPU.

    `jax.jit` with options of the compiler is refused where it is transposed, so the second one, which `grad` transposes, has none.

    Examples
    --------
    >>> import jax
    >>> import jax.numpy as jnp
    >>> from jaxcal._precision import host_float64
    >>> square = host_float64(lambda x: jnp.sum(x**2))
    >>> print(jax.grad(lambda x: jax.grad(square)(x)[0])(jnp.array([3.0, 1.0])))
    [2. 0.]
    """

    _structure: Any
    _beside: list[Any]

    def __init__(self, function: Callable[..., Any], call: _Call):
        def run(tracers: list[Any]) -> list[Any]:
            args, kwargs = call.arguments(tracers)
            leaves, self._structure = jax.tree.flatten(function(*args, **kwargs))
            self._beside = [None if isinstance(leaf, jax.Array) else leaf for leaf in leaves]
            return [leaf for leaf in leaves if isinstance(leaf, jax.Array)]

        run.__name__ = run.__qualname__ = function.__name__
        along, moved = _quick(lambda tracers: jax.linearize(run, tracers)), jax.jit(lambda along, change: along(change))

        def derived(tracers: tuple, change: tuple) -> Any:
            found, slope = along(*tracers)
            return found, moved(slope, *change)

        self._run = _quick(run, derived)

    def __call__(self, tracers: list[Any]) -> Any:
        following = iter(self._run(tracers))
        return jax.tree.unflatten(self._structure, [next(following) if leaf is None else leaf for leaf in self._beside])


def _quick(function: Callable[..., Any], derived: Callable[..., Any] | None = None) -> Callable[..., Any]:
    """`jax.jit` with the options `QUICK` where it is not differentiated; `derived` is its rule there, of (data, change)."""
    plain, quick = jax.jit(function), jax.jit(function, compiler_options=QUICK)
    found = jax.custom_jvp(lambda data: quickly(quick, plain, data))
    found.defjvp(derived or (lambda data, change: jax.jvp(plain, data, change)))
    return found


@functools.lru_cache(maxsize=32)
def _traced_once(function: Callable[..., Any], call: _Call) -> _Program:
    return _Program(function, call)


def _as_one(function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    """A traced call as one program: an eager `grad` or `vmap` would otherwise compile hundreds of operations, one by one.

    Only the tracers are its data. What the host knows stays known, and a call in which it differs is traced again.
    """
    call = _Call(args, kwargs)
    tracers, call.tracers = call.tracers, []  # the call is kept, and a tracer must not outlive its trace
    try:
        program = _traced_once(function, call)
    except TypeError:  # an argument that cannot be compared
        return function(*args, **kwargs)
    return program(tracers)


#: the data of the call in progress in this thread, which `host_float64` has looked at already
_looked = threading.local()


def real_numbers(values: Any, name: str = "the data") -> np.ndarray:
    """An array in float64, with NaN where it is masked; refused if it does not hold real numbers of a size that squares can be taken of.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._precision import real_numbers
    >>> real_numbers(np.ma.masked_greater([1, 2, 9], 5))
    array([ 1.,  2., nan])
    """
    if values is not None and values is getattr(_looked, "data", None):
        return values
    if isinstance(values, Tracer):
        raise DataError(f"{name} are needed on the host, which decides by them; call this outside of jit, vmap and grad", code="traced")
    try:
        array = np.asanyarray(values)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name} must be an array of numbers: {error}", code="not_numbers") from error
    if array.dtype.kind not in "fiu":
        raise DataError(f"{name} must hold real numbers; got values of type {array.dtype}", code="not_numbers")
    masked = np.ma.getmaskarray(array) if isinstance(array, np.ma.MaskedArray) else None
    array = np.asarray(array).astype(np.float64, copy=False)
    if masked is not None:
        array = np.where(masked, np.nan, array)
    size = max(np.fmax.reduce(array, axis=None, initial=0.0), -np.fmin.reduce(array, axis=None, initial=0.0))
    wrong = f"below {LARGEST**-2:g} alone" if 0.0 < size < LARGEST**-2 else ""
    if size > LARGEST and np.any(np.isfinite(array) & (np.abs(array) > LARGEST)):
        wrong = f"beyond {LARGEST:g}"
    if wrong:
        raise DataError(f"{name} hold values {wrong}, which no sensor gives; check how they were read", code="not_numbers")
    return array


def as_there_is(leaf: Any) -> Any:
    """An array in a trace, without float64 where that is off: JAX leaves it to one of NumPy that it has met with it, not to a new one."""
    wide = isinstance(leaf, np.ndarray | jax.Array) and leaf.dtype == np.float64
    return leaf.astype(np.float32) if wide and not setting("jax_enable_x64") else leaf


def _to_float64(leaf: Any) -> Any:
    if isinstance(leaf, np.ndarray) and leaf.dtype == np.float64 and not isinstance(leaf, np.ma.MaskedArray):
        return leaf  # the usual case; the rest takes ten times as long
    if isinstance(leaf, np.ma.MaskedArray):
        return real_numbers(leaf)
    if (isinstance(leaf, (np.ndarray, jax.Array)) or type(leaf) is np.float32) and jnp.issubdtype(leaf.dtype, jnp.floating):
        return np.asarray(leaf, dtype=np.float64)
    return leaf


def _to_numpy(leaf: Any) -> Any:
    return np.asarray(leaf) if isinstance(leaf, jax.Array) else leaf


def host_float64(function: F) -> F:
    """Run a host function in float64 and return NumPy arrays.

    If an argument is a tracer, or a trace is in progress, the function runs unchanged in the caller's precision: this is the
    differentiable path. Outside of `jit` it runs as one program. If that precision is float32 it warns once (`PrecisionWarning`), because
    phase is an integral: with a mean of 9.81, the float32 Allan deviation at m = 1 is wrong by a factor of tens.

    Otherwise the data, the first argument, must hold real numbers (`real_numbers`), and masked values become NaN. The call enters
    ``jax.enable_x64(True)`` as the outermost context, converts floating inputs to float64, and
    converts every JAX array of the result to a NumPy array before leaving. (Outside the context, a float64 JAX array would
    silently become float32.) The context is thread-local: worker threads must enter it themselves.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal._precision import host_float64
    >>> mean = host_float64(lambda x: jnp.mean(x))
    >>> str(mean(jnp.ones(3)).dtype)
    'float64'
    """
    first = "".join(inspect.unwrap(function).__code__.co_varnames[:1])

    @functools.wraps(function)
    def driver(*args: Any, **kwargs: Any) -> Any:
        if _Fork.severed:
            raise DataError(
                "this process was forked from one in which JAX had already computed, and here no computation would end: start processes "
                'afresh, with multiprocessing.get_context("spawn"), or fork before anything is computed'
            )
        leaves = jax.tree.leaves((args, kwargs))
        if is_traced(leaves):
            if not setting("jax_enable_x64"):
                warnings.warn(
                    f"{function.__module__}.{function.__name__} is traced in float32, in which integrated data lose "
                    "their small differences. Put these two lines at the top of the program:\n"
                    "    import jax\n"
                    '    jax.config.update("jax_enable_x64", True)',
                    PrecisionWarning,
                    stacklevel=2,
                )
                args, kwargs = map_ordered(as_there_is, (args, kwargs))
            return function(*args, **kwargs) if is_traced() else _as_one(function, args, kwargs)
        # the data come first; flags and names of groups may follow, and results that hold flags are no data
        data = args[0] if args else kwargs.get(first)
        plain = isinstance(data, list) and all(isinstance(leaf, int | float) for leaf in jax.tree.leaves(data))
        if plain or isinstance(data, np.ndarray):
            _looked.data = known if (known := real_numbers(data)) is data else None
        try:
            with jax.enable_x64(True):
                if any(_to_float64(leaf) is not leaf for leaf in leaves):
                    args, kwargs = map_ordered(_to_float64, (args, kwargs))
                result = function(*args, **kwargs)
                return map_ordered(_to_numpy, result) if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(result)) else result
        finally:
            _looked.data = None

    return driver  # type: ignore[return-value]
