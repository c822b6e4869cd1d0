"""Exceptions and warnings. Every message says what was found, what was expected and how to correct it."""


class JaxcalError(ValueError):
    """Base class of all errors that jaxcal raises on purpose."""


class DataError(JaxcalError):
    """The data do not allow an answer (too short, constant, unreadable, contradictory)."""


class UnitError(JaxcalError):
    """A unit is unknown, or belongs to another quantity."""


class FitError(JaxcalError):
    """A fit did not produce a usable result; the message contains the sentence of its outcome."""


class ExportError(JaxcalError):
    """A result cannot be written in the requested format without losing information that the format needs."""


class PrecisionWarning(UserWarning):
    """A traced computation, which is the differentiable path, runs in float32."""
