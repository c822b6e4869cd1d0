"""Exceptions and warnings. Every message says what was got, what was expected and what mends it."""


class JaxcalError(ValueError):
    """Base of every error that jaxcal raises on purpose."""


class DataError(JaxcalError):
    """The data do not allow an answer (too short, constant, unreadable, contradictory)."""


class UnitError(JaxcalError):
    """A unit is unknown, or belongs to another quantity."""


class FitError(JaxcalError):
    """A fit did not produce a usable result; the message carries the outcome's sentence."""


class ExportError(JaxcalError):
    """A result cannot be written in the asked format without losing what the format needs."""


class PrecisionWarning(UserWarning):
    """The differentiable path runs in float32."""
