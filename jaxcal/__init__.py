"""jaxcal: calibrated models of inertial and magnetic sensors, with honest uncertainty."""

import importlib.metadata

from . import allan as allan, noise as noise
from ._errors import (
    DataError as DataError,
    ExportError as ExportError,
    FitError as FitError,
    JaxcalError as JaxcalError,
    PrecisionWarning as PrecisionWarning,
    UnitError as UnitError,
)
from ._log import Log as Log

__version__ = importlib.metadata.version("jaxcal")
