"""The application: its commands, the configuration file, and the exit status for each error."""

import errno
import functools
import io
import itertools
import os
import sys
import textwrap
import tomllib
import traceback
from pathlib import Path
from typing import Any, NamedTuple

import cyclopts
from cyclopts.config import Toml

import jaxcal

from ._advice import KINDS, advice, code_of, example_of, format_of
from ._apply import apply, convert
from ._batch import batch
from ._budget import budget, sheet
from ._cache import cache
from ._curves import allan, psd
from ._demo import demo
from ._device import device
from ._diff import diff
from ._export import export_to
from ._imu import imu
from ._info import info
from ._mag import mag
from ._noise import noise
from ._north import north
from ._options import CallError
from ._simulate import simulate_device, simulate_imu, simulate_mag, simulate_noise, simulate_north, simulate_temperature
from ._temperature import temperature
from ._turntable import rate_table

_COMMANDS = (
    demo, info, noise, allan, psd, temperature, imu, rate_table, mag, device, north, apply, convert, export_to(""), diff, batch, cache,
    budget, sheet,
)  # fmt: skip
_SIMULATE = (simulate_noise, simulate_temperature, simulate_imu, simulate_mag, simulate_device, simulate_north)
_ANYWHERE = ("--quiet", "-q", "--verbose", "-v")  # options that may also stand before the command
DONE, DATA, CALL, FAULT, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 3, 130, 141

_HELP = """Calibrated models of inertial and magnetic sensors, from their logs.

Every command reads any supported log, prints what it guessed about it, and
ends with status 0 (done), 1 (the data do not allow an answer; the reason is
printed) or 2 (the call was wrong). To see it work: jaxcal demo"""


def _configuration(app, commands, arguments):
    """Take options that are not on the command line from the table [command] of the file given with --config."""
    for argument in arguments:
        if "--config" in argument.names and argument.tokens:
            file = argument.tokens[0].value
            try:
                tomllib.loads(Path(file).read_text(encoding="utf-8"))
            except FileNotFoundError:
                raise CallError(f"--config {file}: there is no such file", "no_config") from None
            except ValueError as error:
                said = f'--config {file} is not TOML ({error}); it holds a table for each command, as [noise] terms = "QNBK"'
                raise CallError(said, "no_toml") from None
            Toml(file)(app, commands, arguments)


def _shown(value: Any) -> str | None:
    """A default in the help; none for what is not there, or switched off."""
    return None if value is None or value is False or value in ((), "") else str(value)


@functools.cache
def _application(format: str = "") -> cyclopts.App:
    """The application; `jaxcal export` has the options of this format."""
    app = cyclopts.App(
        name="jaxcal", help=_HELP, help_format="plaintext", version=lambda: jaxcal.__version__, version_flags=["--version"],
        config=_configuration, default_parameter=cyclopts.Parameter(negative=(), show_default=_shown), result_action="return_value",
        suppress_keyboard_interrupt=False,
    )  # fmt: skip
    for command in _COMMANDS:
        epilogue = f"Example: {example_of(command.__name__.replace('_', '-'))}"
        if command.__name__ == "export" and format:
            command, epilogue = export_to(format), epilogue.replace("kalibr", format)
        app.command(command, help_epilogue=epilogue)
    simulate = cyclopts.App(name="simulate", help="Logs of simulated devices, whose truth is known.", help_format="plaintext")
    for command in _SIMULATE:
        kind = command.__name__.removeprefix("simulate_")
        simulate.command(command, name=kind, help_epilogue=f"Example: {example_of(f'simulate {kind}')}")
    app.command(simulate)
    return app


class Failure(NamedTuple):
    """Why a command ended without success: exit status, what is printed, and the code of the error."""

    status: int
    text: str = ""
    code: str = ""


def run(argv: list[str]) -> int:
    """Run the command line `argv` and return its exit status; every expected failure prints one paragraph on standard error."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # do not fail if a terminal lacks a character
    failure = attempt(argv)
    if failure is None:
        return DONE
    if failure.text:
        print(textwrap.fill(f"jaxcal: {failure.text}", 80, break_long_words=False, break_on_hyphens=False), file=sys.stderr)
    return failure.status


def attempt(argv: list[str]) -> Failure | None:
    """Run the command line `argv`; returns why it failed, or None. Tests ask for the code of a failure, and not for its wording."""
    before = list(itertools.takewhile(_ANYWHERE.__contains__, argv))
    argv = [*argv[len(before) :], *before] if len(before) < len(argv) else []
    try:
        _application(format_of(argv))(argv, exit_on_error=False, print_error=False)
        sys.stdout.flush()
        return None
    except cyclopts.CycloptsError as error:
        if isinstance(error.__cause__, CallError):  # a check of one option, which the parser reports as its own
            return _wrong_call(error.__cause__, argv)
        said = advice(error, argv, _options()) or str(error).strip()
        return Failure(CALL, f"{said} (see: {_help_command(argv)})", code_of(error))
    except (CallError, jaxcal.UnitError) as error:
        return _wrong_call(error, argv)
    except jaxcal.JaxcalError as error:
        return Failure(DATA, error.spelt("terminal"), error.code)
    except KeyboardInterrupt:
        return Failure(INTERRUPTED, "interrupted")
    except OSError as error:
        if isinstance(error, BrokenPipeError) or error.errno == errno.EPIPE:
            _discard_output()
            return Failure(PIPE_CLOSED)
        return Failure(CALL, f"{error.filename or 'a file'}: {(error.strerror or str(error)).lower()}", "os")
    except Exception:  # a fault in jaxcal: print the trace, which a bug report needs
        traceback.print_exc()
        return Failure(FAULT, "this is a fault in jaxcal, not in your data or call; please report the lines above at "
                       "https://github.com/jaxcal/jaxcal/issues")  # fmt: skip


def _wrong_call(error: jaxcal.JaxcalError, argv: list[str]) -> Failure:
    return Failure(CALL, f"{error.spelt('terminal')} (see: {_help_command(argv)})", error.code)


def _names() -> list[str]:
    """Names of the commands as typed by the user."""
    return [command.__name__.replace("_", "-") for command in _COMMANDS]


@functools.cache
def _options() -> dict[str, set[str]]:
    """Command -> names of its options; for simulate, the options of all kinds together."""
    app, found = _application(), {}
    for name in (*_names(), "simulate"):
        parts = [app[name]] if name != "simulate" else [app[name][command.__name__.removeprefix("simulate_")] for command in _SIMULATE]
        found[name] = {one for part in parts for argument in part.assemble_argument_collection() for one in argument.names if one[0] == "-"}
    return found


def _help_command(argv: list[str]) -> str:
    known = {*_names(), "simulate"}
    words = [word for word in argv[:1] if word in known]
    words += [word for word in argv[1:2] if words == ["simulate"] and word in KINDS]
    return " ".join(["jaxcal", *words, "--help"])


def _discard_output() -> None:
    """Redirect standard output to the null device, so that the interpreter can flush its remaining output without an error."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
