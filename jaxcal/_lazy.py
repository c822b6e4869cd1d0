"""Packages whose modules are imported when they are first used."""

import importlib
import sys
from collections.abc import Callable
from typing import Any


def on_first_use(package: str, homes: dict[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package; `homes` maps each module to its public names, separated by spaces.

    Examples
    --------
    >>> from jaxcal._lazy import on_first_use
    >>> get, names = on_first_use("jaxcal", {"_errors": "DataError UnitError"})
    >>> get("DataError").__name__
    'DataError'
    """
    home = {name: module for module, names in homes.items() for name in names.split()}

    def __getattr__(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = importlib.import_module(f".{home[name]}", package)
        value = module if name == home[name] else getattr(module, name)
        setattr(sys.modules[package], name, value)
        return value

    def __dir__() -> list[str]:
        return sorted({*(name for name in vars(sys.modules[package]) if name.startswith("__")), *home})

    return __getattr__, __dir__


def install(package: str, homes: dict[str, str]) -> None:
    """Give a package the `__getattr__` and `__dir__` of `on_first_use`; assigned in it by name, they would be public and without a type."""
    get, names = on_first_use(package, homes)
    vars(sys.modules[package]).update(__getattr__=get, __dir__=names)
