"""Exceptions and warnings. Every message says what was found, what was expected and how to correct it."""


class JaxcalError(ValueError):
    """Base class of all errors that jaxcal raises on purpose.

    Parameters
    ----------
    message : the sentence, as text or as a `Message` that names options.
    code : name of the fault, for programs and tests; "" if it has none.
    subject : the channel, log or file in which it was found, which stands before the sentence; "" for none.
    """

    def __init__(self, message: object = "", code: str = "", subject: str = ""):
        super().__init__(message)
        self.code: str = code
        self.subject: str = subject

    def __str__(self) -> str:
        return self.spelt("python")

    def spelt(self, reader: str) -> str:
        """The sentence as a reader of "python" or of the "terminal" types it."""
        message = self.args[0]
        return f"{self.subject}: " * bool(self.subject) + (message.spelt(reader) if hasattr(message, "spelt") else str(message))

    def of(self, subject: str) -> "JaxcalError":
        """Name the channel, log or file that the error is about."""
        self.subject = ": ".join(one for one in (subject, self.subject) if one)
        return self


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
