"""jaxcal: calibrated models of inertial and magnetic sensors, with honest uncertainty.

Parts are imported when they are first used, so that ``import jaxcal`` is quick, loads neither JAX nor a reader, and leaves
every JAX setting as it is.
"""

import importlib
from typing import TYPE_CHECKING, Any

from ._errors import (
    DataError as DataError,
    ExportError as ExportError,
    FitError as FitError,
    JaxcalError as JaxcalError,
    PrecisionWarning as PrecisionWarning,
    UnitError as UnitError,
)

if TYPE_CHECKING:
    from . import (
        alignment as alignment,
        allan as allan,
        batch as batch,
        calibration as calibration,
        export as export,
        fitting as fitting,
        imu as imu,
        io as io,
        magnetometer as magnetometer,
        noise as noise,
        plot as plot,
        report as report,
        spectrum as spectrum,
        temperature as temperature,
    )
    from ._log import Log as Log
    from .calibration import Calibration as Calibration
    from .io import read as read

    __version__: str

#: public name -> the module it is, or comes from
_HOME = {
    "alignment": "alignment",
    "allan": "allan",
    "batch": "batch",
    "calibration": "calibration",
    "export": "export",
    "fitting": "fitting",
    "imu": "imu",
    "io": "io",
    "magnetometer": "magnetometer",
    "noise": "noise",
    "plot": "plot",
    "report": "report",
    "spectrum": "spectrum",
    "temperature": "temperature",
    "Calibration": "calibration",
    "Log": "_log",
    "read": "io",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        value: Any = importlib.import_module("importlib.metadata").version("jaxcal")
    elif name in _HOME:
        module = importlib.import_module(f".{_HOME[name]}", __name__)
        value = module if name == _HOME[name] else getattr(module, name)
    else:
        raise AttributeError(f"module 'jaxcal' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    hidden = {"TYPE_CHECKING", "Any", "importlib"}
    return sorted({*globals(), *_HOME, "__version__"} - hidden)
