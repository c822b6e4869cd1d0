"""Advice on wrong calls: for every error of the parser, the command line that works."""

import difflib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

#: commands that take a log
LOGS = ("info", "noise", "allan", "psd", "temperature", "imu", "rate-table", "mag", "device", "north")
#: commands that `jaxcal batch --task` can run
TASKS = ("noise", "mag", "imu", "temperature", "allan")
_OTHER_NAMES = {
    "magnetometer": "mag", "compass": "mag", "magcal": "mag", "calibrate-mag": "mag", "ellipsoid": "mag", "accel": "imu",
    "accelerometer": "imu", "gyro": "noise", "gyroscope": "noise", "avar": "allan", "adev": "allan", "oadev": "allan", "spectrum": "psd",
    "fft": "psd", "thermal": "temperature", "temp": "temperature", "azimuth": "north", "gyrocompass": "north", "alignment": "north",
    "inspect": "info", "show": "info", "read": "info", "columns": "info", "correct": "apply", "compare": "diff", "fleet": "batch",
    "sim": "simulate", "clear-cache": "cache --clear", "help": "--help", "version": "--version", "plot": "noise LOG --plot FILE.png",
    "report": "noise LOG --report FILE.html",
}  # fmt: skip
_OTHER_OPTIONS = {
    "--output": "--out", "-o": "--out", "--outdir": "--out", "--output-dir": "--out", "--save": "--out", "--fs": "--rate",
    "--freq": "--rate", "--frequency": "--rate", "--hz": "--rate", "--sample-rate": "--rate", "--sampling-rate": "--rate",
    "--lat": "--latitude", "--column": "--columns", "--device": "--name",
    "--format": "--to", "--tool": "--to", "--overwrite": "--force", "--topic": "--topics", "--html": "--report FILE.html",
    "--png": "--plot FILE.png", "--figure": "--plot FILE.png", "--picture": "--plot FILE.png", "--yaml": "--export kalibr",
    "--kalibr": "--export kalibr", "--csv": "--export csv", "--begin": "--start", "--from": "--start", "--end": "--stop",
    "--until": "--stop", "--silent": "--quiet", "--jobs": "--workers", "-j": "--workers", "--threads": "--workers",
    "--level": "--confidence", "--alpha-level": "--confidence", "--random-seed": "--seed", "--g": "--gravity",
    "--local-gravity": "--gravity", "--dip": "--inclination", "--declination": "--inclination",
}  # fmt: skip
#: kinds of logs that `jaxcal simulate` makes
KINDS = ("noise", "temperature", "imu", "mag", "device", "north")
_USAGE = {
    "apply": "jaxcal apply calibration.json LOG.csv --out corrected.csv", "convert": "jaxcal convert LOG.csv LOG.npz",
    "export": "jaxcal export calibration.json --to kalibr", "budget": "jaxcal budget calibration.json --motion hand",
    "sheet": 'jaxcal sheet "gyro: ARW 0.3 deg/sqrt(h), BI 2 deg/h" --to kalibr', "diff": "jaxcal diff old.json new.json",
    "batch": "jaxcal batch logs/ --task noise --out fleet", "north": "jaxcal north table.csv --latitude 39.93",
    "simulate noise": 'jaxcal simulate noise --gyro "N=0.25deg/sqrt(h)" --out log.csv',
    "simulate north": "jaxcal simulate north --latitude 39.93 --out table.csv",
    "simulate": 'jaxcal simulate noise --gyro "N=0.25deg/sqrt(h)" --out log.csv', "demo": "jaxcal demo", "cache": "jaxcal cache --clear",
    "imu": "jaxcal imu LOG.csv --latitude 39.93", "device": "jaxcal device LOG.csv --latitude 39.93",
    "mag": "jaxcal mag LOG.csv --place 39.93 32.86 --date 2026-05-31", "rate-table": "jaxcal rate-table LOG.csv --rates 10,50,100",
}  # fmt: skip
_STDIN = "jaxcal reads files, and not its standard input: save the log first (cat > log.csv), then: jaxcal {} log.csv"
_LOG_NAME = re.compile(r"\.(csv|tsv|txt|dat|npy|npz|parquet|bag|mcap|db3|mat|h5|hdf5|ulg|bin|log|zip|gz)$", re.IGNORECASE)
_FIRST = 4096  # bytes


def advice(error: Any, argv: Sequence[str], options: dict[str, set[str]]) -> str | None:
    """A sentence that replaces the parser's own message, or None if that message is good enough.

    Parameters
    ----------
    error : the exception raised by the parser.
    argv : the command line.
    options : command -> names of its options.
    """
    command = next((word for word in argv if not word.startswith("-")), "")
    name = type(error).__name__
    if name == "UnknownCommandError" and command == "simulate":
        kinds = ", ".join(KINDS)
        return f"jaxcal simulate takes what to simulate: {kinds}. For example: {_USAGE['simulate']}"
    if name == "UnknownCommandError" or (command and command not in options):
        return _unknown_command(command or argv[0].lstrip("-"), argv, options)
    if name == "UnknownOptionError" and command == "export" and (format := format_of(argv)):
        return _not_of_format(_word(error), format)
    if name == "UnknownOptionError" and getattr(error.token, "source", "cli") == "cli":  # not from the file of --config
        return _unknown_option(_word(error), command, options)
    if name == "UnusedCliTokensError":
        return _too_much([str(word) for word in error.unused_tokens or ()], command, argv)
    if name == "CoercionError":
        return _not_a_number(error)
    if name in ("MissingArgumentError", "ConsumeMultipleError"):
        return _missing(error, command, argv)
    return None


def code_of(error: Any) -> str:
    """Code of an error of the parser, from the name of its class.

    Examples
    --------
    >>> from cyclopts import UnknownOptionError
    >>> from jaxcal.cli._advice import code_of
    >>> code_of(UnknownOptionError.__new__(UnknownOptionError))
    'unknown_option'
    """
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", type(error).__name__.removesuffix("Error")).lower()


def _word(error: Any) -> str:
    token = getattr(error, "token", None)
    return str(getattr(token, "keyword", None) or getattr(token, "value", None) or "").partition("=")[0]


def _unknown_command(word: str, argv: Sequence[str], options: dict[str, set[str]]) -> str | None:
    if word == "help" and argv[-1] in options:
        return f"there is no command help; use: jaxcal {argv[-1]} --help"
    if Path(word).exists() or _LOG_NAME.search(word):
        return f"{word} is a file, and the first word is the command: jaxcal info {word} says what is in it and which commands suit it"
    if meant := _OTHER_NAMES.get(word.lower().replace("_", "-")):
        return f"there is no command {word}; use: jaxcal {meant}"
    close = difflib.get_close_matches(word, list(options), 1)
    known = ", ".join(options)
    return f'there is no command {word}. Did you mean "{close[0]}"?' if close else f"there is no command {word}; the commands are {known}"


def _unknown_option(word: str, command: str, options: dict[str, set[str]]) -> str | None:
    known = options.get(command, set())
    if word == "-":
        return _STDIN.format(command)
    if (meant := _OTHER_OPTIONS.get(word.lower())) and meant.split()[0] in known:
        return f"jaxcal {command} has no option {word}; use {meant}"
    close = difflib.get_close_matches(word, sorted(known), 1, 0.8)
    if close:
        return f'jaxcal {command} has no option {word}. Did you mean "{close[0]}"?'
    if owners := [name for name, names in options.items() if word in names]:
        many = f"jaxcal {owners[0]}" if len(owners) == 1 else "jaxcal " + ", ".join(owners[:-1]) + f" and {owners[-1]}"
        return f"{word} is an option of {many}, not of jaxcal {command}; leave it out, or use that command"
    return f"jaxcal {command} has no option {word}; jaxcal {command} --help lists those it has"


def _not_of_format(word: str, format: str) -> str:
    from ..export._formats import FORMATS

    option = word.removeprefix("--").replace("-", "_")
    known = [name for name, one in FORMATS.items() if option in one.options]
    own = ", ".join(f"--{name.replace('_', '-')}" for name in FORMATS[format].options) or "none"
    return f"jaxcal export --to {format} has no option {word}" + (f", which is for {', '.join(known)}" if known else f"; it has {own}")


def format_of(argv: Sequence[str]) -> str:
    """The format that a command line of `jaxcal export` names with --to; "" for none."""
    from ..export._formats import FORMATS

    words = [*argv, ""]
    named = [words[i + 1] if word == "--to" else word.removeprefix("--to=") for i, word in enumerate(argv) if word.split("=")[0] == "--to"]
    return next((name for name in named if name in FORMATS), "")


def _too_much(words: list[str], command: str, argv: Sequence[str]) -> str | None:
    given = [word for word in argv[1:] if not word.startswith("-") and (Path(word).exists() or _LOG_NAME.search(word))]
    if command in LOGS and len(given) > 1:
        if json := next((word for word in given if word.endswith(".json")), None):
            rest = next(word for word in given if word != json)
            if command == "noise":
                return f"jaxcal noise takes one log. To correct it with a calibration first: jaxcal noise {rest} --calibration {json}"
            return f"jaxcal {command} takes one log. To correct it first: jaxcal apply {json} {rest} --out corrected.npz"
        each = (
            f": jaxcal batch {' '.join(given)} --task {command} --out fleet"
            if command in TASKS
            else f", one after the other: jaxcal {command} {given[0]}"
        )
        return f"jaxcal {command} takes one log, and {' and '.join(given[:3])} are {len(given)}. To work on each{each}"
    if words and command in LOGS and re.fullmatch(r"-?[\d.,]+", words[0]):
        return f"{words[0]} belongs to no option: numbers stand behind the name of an option, as in --rate 100"
    if command == "diff" and len(given) > 2:
        return f"jaxcal diff compares two calibrations, and these are {len(given)}: jaxcal diff {given[0]} {given[1]}"
    if words and "--columns" in argv:
        value = argv[argv.index("--columns") + 1]
        meant = ("" if "=" in value else "gyro=") + ",".join([value, *words])
        return f"the columns of a quantity stand together, with commas: --columns {meant}"
    if words and words[0] in argv and (before := argv[argv.index(words[0]) - 1]).startswith("--"):
        return f"{before} takes no value here; leave out {words[0]}"
    if words:
        return f"jaxcal {command} has no use for {' '.join(words)}; a name with spaces stands in quotes"
    return None


def _not_a_number(error: Any) -> str | None:
    """Advice on a wrong number: omit its unit, use a decimal point, or give a number."""
    token = getattr(error, "token", None)
    text, option = str(getattr(token, "value", "") or ""), str(getattr(token, "keyword", "") or "")
    if not option or getattr(error, "target_type", None) not in (float, int):
        return None
    if re.fullmatch(r"-?\d+,\d+", text):
        return f"{option} {text}: numbers have a decimal point: {option} {text.replace(',', '.')}"
    if option in ("--start", "--stop") and re.fullmatch(r"\d+:\d\d(:\d\d)?", text):
        seconds = sum(60**i * int(part) for i, part in enumerate(text.split(":")[::-1]))
        return f"{option} {text}: give seconds: {option} {seconds}"
    if found := re.fullmatch(r"(-?\d+(?:\.\d+)?)\s*([A-Za-z%°/].*)", text):
        return f"{option} {text}: give the number alone, in the unit of --help, as {found[1]}"
    return f"{option} {text}: expected a {'whole number' if error.target_type is int else 'number'}"


def example_of(command: str) -> str:
    """A call of a command that works."""
    if command.startswith("simulate "):
        return _USAGE.get(command, f"jaxcal {command} --out log.csv")
    return _USAGE.get(command, f"jaxcal {command} LOG.csv")


def _missing(error: Any, command: str, argv: Sequence[str]) -> str | None:
    name = str(getattr(getattr(error, "argument", None), "name", "") or "")
    usage = example_of(f"simulate {argv[1]}" if command == "simulate" else command)
    if name in argv:
        rest = list(argv[argv.index(name) + 1 :])
        if rest and re.fullmatch(r"-?[\d.]+,-?[\d.]+(,-?[\d.]+)*", rest[0]):
            return f"{name} {rest[0]}: the numbers stand apart: {name} {rest[0].replace(',', ' ')}"
        if rest and not rest[0].startswith("-"):
            return f"{name} {rest[0]}: a value is missing; {name} takes more than one"
        help = error.argument.parameter.help or f"jaxcal {command} --help says what it takes"
        return f"{name} stands without its value. {help}"
    if name.startswith("--"):
        return f"jaxcal {command} needs {name}: {usage}"
    if command in LOGS:
        what = "table of readings, or a log" if command == "north" else "log"
        return f"jaxcal {command} needs a {what}: {usage}. To see how it works: jaxcal demo"
    return f"jaxcal {command} needs {name.replace('_', ' ')}: {usage}"


# the files


def kind_of(path: Path) -> str:
    """Kind of a file that is not a log: "calibration", "result", "report", "picture", or "" for anything else."""
    try:
        if not path.is_file() or not path.stat().st_size:  # pipes, and files of the kernel, block
            return ""
        with path.open("rb") as file:
            head = file.read(_FIRST)
    except OSError:
        return ""
    if head.startswith((b"\x89PNG", b"\xff\xd8\xff", b"%PDF")) or b"<svg" in head[:300]:
        return "picture"
    text = head.decode("utf-8", "replace").lstrip("\ufeff \t\r\n")
    if text[:15].lower().startswith(("<!doctype html", "<html")):
        return "report"
    if not text.startswith("{"):
        return ""
    schema = re.search(r'"schema"\s*:\s*"jaxcal\.([\w./]+)"', text)
    return "" if schema is None else "calibration" if schema[1].startswith("calibration") else "result"


def not_a_log(path: Path, command: str) -> str | None:
    """Sentence that says why a path is not a log, with the intended call; None if it may be a log."""
    name = str(path)
    if name in ("-", "/dev/stdin", "/dev/fd/0", "/proc/self/fd/0"):
        return _STDIN.format(command)
    if "://" in name or re.match(r"https?:/", name):
        return f"{re.sub(':/+', '://', name, count=1)} is an address; download the log first, and give the file"
    if not path.exists():
        return _not_there(path, command)
    if path.is_dir():
        return None
    kind = kind_of(path)
    if kind == "calibration":
        return (
            f"{name} is a calibration and not a log; jaxcal apply {name} LOG --out corrected.npz applies it to a log, and "
            f"jaxcal export {name} --to kalibr writes it for another tool"
        )
    if kind == "result":
        return f"{name} holds results of jaxcal and is not a log; give the log that they came from"
    if kind in ("report", "picture"):
        return f"{name} is a {kind} and not a log; give the log that it was made from"
    return None


def _not_there(path: Path, command: str) -> str:
    name = str(path)
    if any(mark in name for mark in "*?["):
        task = command if command in TASKS else "noise"
        if command not in LOGS:
            return f"{name} does not exist; give one file"
        return f"{name} does not exist; for all files of a pattern: jaxcal batch '{name}' --task {task} --out fleet"
    folder = path.parent
    if not folder.is_dir():
        return f"{name} does not exist, because there is no folder {folder}"
    names = [one.name for one in folder.iterdir() if not one.name.startswith(".")][:2000]
    close = [one for one in names if one.rpartition(".")[0] == path.name] or difflib.get_close_matches(path.name, names, 1, 0.8)
    return f"{name} does not exist" + (f". Did you mean {folder / close[0]}?" if close else f"; the folder is {folder.absolute()}")


def not_a_calibration(path: Path, option: str = "") -> str | None:
    """Sentence that says why a path is not a calibration; None if it may be one."""
    head = f"{option} {path}".strip()
    if not path.exists():
        return f"{head}: {_not_there(path, 'apply')}" if option else _not_there(path, "apply")
    if path.is_dir():
        there = path / "calibration.json"
        return f"{head} is a folder; give the calibration in it" + (
            f": {there}" if there.exists() else ", a file such as calibration.json. jaxcal apply takes the latest one with --name NAME"
        )
    kind = kind_of(path)
    if kind == "result":
        there = path.with_name("calibration.json")
        return f"{head} holds results of jaxcal; the calibration is the file calibration.json" + (
            f": {there}" if there.exists() else " beside it"
        )
    if kind in ("", "report", "picture"):
        what = "a log" if _LOG_NAME.search(path.name) else f"a {kind}" if kind else "no JSON"
        return (
            f"{head} is {what}, and a calibration is asked for: a file calibration.json, as jaxcal noise, imu, mag and temperature write it"
        )
    return None
