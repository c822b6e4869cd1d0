"""Compiled programs kept on disk, so that a command need not trace or compile again what an earlier command did.

JAX's own cache only saves the compilation. Tracing and lowering, which it needs to find an entry, take as long again. Here a program is
found by the inputs of its trace: the function, the shapes and types of its arrays, and all other arguments. This is safe if the source
is known to be the same. So a program is kept only if everything that its arguments refer to belongs to jaxcal or to the packages that it
depends on. A user's own model or term is always traced. The folder belongs to the user: its files are code, like those of JAX's
cache.
"""

import contextlib
import dataclasses
import functools
import hashlib
import importlib.metadata
import io
import os
import pickle
import platform
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ._errors import ExportError
from ._files import write_atomically
from ._jax import no_entry, restored, setting, settings as settings_of_jax, stored

_PACKAGES = ("jax", "jaxlib", "numpy", "equinox", "optimistix", "lineax")
_KNOWN = {"jaxcal", *_PACKAGES, *sys.stdlib_module_names}


@dataclasses.dataclass(frozen=True)
class Slot:
    """A placeholder for an array in a tree, with the properties of the array on which a trace depends."""

    shape: tuple[int, ...]
    dtype: str
    weak: bool


class _Pickler(pickle.Pickler):
    """Refuses objects defined elsewhere, because their source may change while their name stays the same."""

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, type) or callable(obj):
            module = getattr(obj, "__module__", None) or ""
            if module.partition(".")[0] not in _KNOWN:
                raise pickle.PicklingError(f"{obj!r} is not part of jaxcal")
        return NotImplemented


def _pickled(tree: Any) -> bytes:
    buffer = io.BytesIO()
    _Pickler(buffer, protocol=5).dump(tree)
    return buffer.getvalue()


@functools.cache
def _world() -> bytes:
    """Everything besides its arguments on which a program depends: sources, versions, settings and processor."""
    root = Path(__file__).parent
    sources = [(str(path.relative_to(root)), path.stat().st_size, path.stat().st_mtime_ns) for path in sorted(root.rglob("*.py"))]
    versions = [importlib.metadata.version(name) for name in _PACKAGES]
    settings = [os.environ.get("XLA_FLAGS"), settings_of_jax()]
    cpu = Path("/proc/cpuinfo")
    flags = next((line for line in cpu.read_text().splitlines() if line.startswith("flags")), "") if cpu.exists() else platform.processor()
    return repr((sources, versions, settings, flags, sys.version)).encode()


class Store:
    """Programs in a folder, one file per program."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._held: dict[Any, Callable[..., Any] | None] = {}

    def run(self, function: Callable[..., Any], lower: Callable[..., Any], arrays: list[Any], fixed: Any, described: Callable) -> Any:
        """Arrays and structure that the function's program returns for these arguments; None if the program cannot be kept.

        `lower(arrays, fixed)` traces the program; `described(slots)` gives its arguments with a placeholder for each array.
        """
        slots = [Slot(np.shape(array), str(array.dtype), bool(getattr(array, "weak_type", False))) for array in arrays]
        key = (function, tuple(slots), fixed)
        if key not in self._held:
            try:
                name = _pickled((function, described(slots), setting("jax_enable_x64")))
            except (pickle.PicklingError, AttributeError, TypeError):
                self._held[key] = None  # a function inside another one, or a user's function
            else:
                path = self._folder / f"program-{hashlib.sha256(_world() + name).hexdigest()}-cache"
                self._held[key] = _read(path, arrays, fixed) or _made(path, lower(arrays, fixed))
        program = self._held[key]
        return program and program(arrays, fixed)


def _read(path: Path, arrays: list[Any], fixed: Any) -> Callable[..., Any] | None:
    """The program in a file; None if there is no readable one."""
    try:
        code, count, result = pickle.loads(path.read_bytes())
        return restored(code, jax.tree.structure(((arrays, fixed), {})), jax.tree.structure(([0] * count, result)))
    except Exception:  # no file, or any error that a truncated one causes: the program is compiled, and written
        return None


def _made(path: Path, lowered: Any) -> Callable[..., Any]:
    """The program; it is written to its file, with the structure of its results, once that is known."""
    written = False
    with no_entry():
        compiled = lowered.compile()

    def call(arrays: list[Any], fixed: Any) -> Any:
        nonlocal written
        found, result = compiled(arrays, fixed)
        if not written:
            written = True
            # on a full disk, or for a program that JAX cannot store, the next command compiles it again
            with contextlib.suppress(ExportError, pickle.PicklingError, AttributeError, TypeError, ValueError, NotImplementedError):
                write_atomically(path, pickle.dumps((stored(compiled), len(found), result)))
        return found, result

    return call
