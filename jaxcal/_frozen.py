"""Frozen modules: the base of models, and modules made, changed and cut without their `__init__`, which takes most of a short call."""

import dataclasses
import functools
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np

T = TypeVar("T")


#: `__getattribute__` of modules whose methods are called often: a method of theirs is one of Python, not a tree, which takes Equinox 20 us
direct = object.__getattribute__


class Model(eqx.Module):
    """The base of models of sensors, which print their numbers, not the shapes of their arrays."""

    def __repr__(self) -> str:
        with np.printoptions(precision=6):
            return eqx.tree_pformat(self, short_arrays=False)


@functools.cache
def _fields_of(kind: Any) -> tuple[Any, ...]:
    """The fields of a class of modules, which `dataclasses` gathers anew at each call."""
    return dataclasses.fields(kind)


def made(kind: type[T], /, **fields: Any) -> T:
    """A frozen module with these fields, made without its `__init__`, which takes five times as long."""
    new: Any = object.__new__(kind)
    for field in _fields_of(kind):
        value = fields.get(field.name, field.default)
        object.__setattr__(new, field.name, field.default_factory() if value is dataclasses.MISSING else value)
    if unknown := fields.keys() - {field.name for field in _fields_of(kind)}:
        raise TypeError(f"{kind.__name__} has no field {', '.join(sorted(unknown))}")
    return new


def replaced(module: T, /, **fields: Any) -> T:
    """A frozen module with new values in some of its fields, made without its `__init__`."""
    values: Any = module
    return made(type(module), **({field.name: getattr(module, field.name) for field in dataclasses.fields(values)} | fields))


def channel_of(result: Any, name: str, index: int) -> Any:
    """The result for one of several channels, the second axis of `name` and of all other arrays with two."""
    if getattr(result, name).ndim < 2:
        raise IndexError(f"this {name} is of a single channel; there is nothing to pick")
    return jax.tree.map(lambda leaf: leaf[..., index] if leaf.ndim == 2 else leaf, result)
