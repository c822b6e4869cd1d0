"""jaxcal: calibrated models of inertial and magnetic sensors, with honest uncertainty.

Sub-packages are imported when they are first used. So ``import jaxcal`` is quick, loads neither JAX nor a reader, and does not change
any setting of JAX.
"""

import importlib
from typing import TYPE_CHECKING, Any

from ._lazy import on_first_use

if TYPE_CHECKING:
    from . import (
        alignment as alignment,
        allan as allan,
        batch as batch,
        budget as budget,
        calibration as calibration,
        device as device,
        evidence as evidence,
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
    from ._errors import (
        DataError as DataError,
        ExportError as ExportError,
        FitError as FitError,
        JaxcalError as JaxcalError,
        PrecisionWarning as PrecisionWarning,
        UnitError as UnitError,
    )
    from ._log import Log as Log
    from .calibration import Calibration as Calibration
    from .io import read as read

    __version__: str

_PARTS = "alignment allan batch budget device evidence export fitting imu magnetometer noise plot report spectrum temperature"
_part, _names = on_first_use(
    __name__,
    {
        "_errors": "DataError ExportError FitError JaxcalError PrecisionWarning UnitError",
        "_log": "Log",
        "calibration": "calibration Calibration",
        "io": "io read",
        **{name: name for name in _PARTS.split()},
    },
)


def __dir__() -> list[str]:
    return sorted({*_names(), "__version__"})


def __getattr__(name: str) -> Any:
    if name != "__version__":
        return _part(name)
    globals()[name] = version = importlib.import_module("importlib.metadata").version("jaxcal")
    return version
