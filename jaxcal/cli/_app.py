"""The application: its commands, the configuration file, and what each error means for the exit status."""

import errno
import io
import itertools
import os
import sys
import textwrap
import traceback

import cyclopts
from cyclopts.config import Toml

import jaxcal

from ._apply import apply, convert
from ._batch import batch
from ._curves import allan, psd
from ._demo import demo
from ._diff import diff
from ._export import export
from ._imu import imu
from ._info import info
from ._mag import mag
from ._noise import noise
from ._north import north
from ._options import CallError
from ._simulate import simulate_imu, simulate_mag, simulate_noise, simulate_north, simulate_temperature
from ._temperature import temperature
from ._turntable import rate_table, vibration

_COMMANDS = (demo, info, noise, allan, psd, temperature, imu, rate_table, vibration, mag, north, apply, convert, export, diff, batch)
_SIMULATE = (simulate_noise, simulate_temperature, simulate_imu, simulate_mag, simulate_north)
DONE, DATA, CALL, FAULT, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 3, 130, 141

_HELP = """Calibrated models of inertial and magnetic sensors, from their logs.

Every command reads any supported log, prints what it guessed about it, and
ends with status 0 (done), 1 (the data do not allow an answer; the reason is
printed) or 2 (the call was wrong). To see it work: jaxcal demo"""


def _configuration(app, commands, arguments):
    """Fill options that the command line leaves out from the table [command] of the file given with --config."""
    for argument in arguments:
        if "--config" in argument.names and argument.tokens:
            try:
                Toml(argument.tokens[0].value, must_exist=True)(app, commands, arguments)
            except FileNotFoundError:
                raise CallError(f"--config {argument.tokens[0].value}: there is no such file") from None


def _application() -> cyclopts.App:
    app = cyclopts.App(
        name="jaxcal", help=_HELP, help_format="plaintext", version=lambda: jaxcal.__version__, version_flags=["--version"],
        config=_configuration, default_parameter=cyclopts.Parameter(negative=()), result_action="return_value",
        suppress_keyboard_interrupt=False,
    )  # fmt: skip
    for command in _COMMANDS:
        app.command(command)
    simulate = cyclopts.App(name="simulate", help="Logs of simulated devices, whose truth is known.", help_format="plaintext")
    for command in _SIMULATE:
        simulate.command(command, name=command.__name__.removeprefix("simulate_"))
    app.command(simulate)
    return app


def run(argv: list[str]) -> int:
    """Exit status of the command line `argv`; every expected failure becomes one paragraph on standard error."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal that lacks a character is no reason to fail
    try:
        _application()(argv, exit_on_error=False, print_error=False)
        sys.stdout.flush()
        return DONE
    except (cyclopts.CycloptsError, CallError, jaxcal.UnitError) as error:
        _complain(f"{str(error).strip()} (see: {_help_command(argv)})")
        return CALL
    except jaxcal.JaxcalError as error:
        _complain(str(error))
        return DATA
    except KeyboardInterrupt:
        _complain("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        _discard_output()
        return PIPE_CLOSED
    except OSError as error:
        if error.errno == errno.EPIPE:
            _discard_output()
            return PIPE_CLOSED
        _complain(f"{error.filename or 'a file'}: {(error.strerror or str(error)).lower()}")
        return CALL
    except Exception:  # a fault of ours: the trace is what its report needs
        traceback.print_exc()
        _complain("this is a fault in jaxcal, not in your data or call; please report the lines above at "
                  "https://github.com/jaxcal/jaxcal/issues")  # fmt: skip
        return FAULT


def _complain(text: str) -> None:
    print(textwrap.fill(f"jaxcal: {text}", 80, break_long_words=False, break_on_hyphens=False), file=sys.stderr)


def _help_command(argv: list[str]) -> str:
    known = {command.__name__.replace("_", "-") for command in _COMMANDS} | {"simulate"}
    words = itertools.takewhile(lambda word: word in known, argv)
    return " ".join(["jaxcal", *words, "--help"])


def _discard_output() -> None:
    """Let the interpreter flush its remaining output without another complaint."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
