"""Least squares for every calibration: the only user of optimistix and lineax in the package."""

from ._covariance import covariance as covariance, standard_errors as standard_errors
from ._fit import solve as solve
from ._loss import AbstractLoss as AbstractLoss, Cauchy as Cauchy, Huber as Huber, SoftL1 as SoftL1, Tukey as Tukey
from ._many import solve_many as solve_many
from ._nonnegative import Nonnegative as Nonnegative, nonnegative as nonnegative
from ._outcome import Outcome as Outcome
from ._profile import Interval as Interval, profile_interval as profile_interval
from ._rank import Identifiability as Identifiability, identifiability as identifiability
from ._result import Fit as Fit
