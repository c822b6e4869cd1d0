"""The tasks of a run: those with a name, and functions given by the user."""

import functools
import hashlib
import importlib
import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from .._answer import Finding, Grid, Number, Result, Results, numbers_of, ordered, plain
from .._errors import DataError, UnitError
from .._files import version_of
from .._log import Log
from .._message import Message
from ..evidence._findings import unrest
from ..evidence._values import at_own_rate
from ..io._suited import unsuited
from ._findings import FINDINGS


def mag(log: Log, **options: Any) -> Any:
    """Fit hard and soft iron."""
    from ..magnetometer import fit

    if log.mag is None or log.mag.shape[1] != 3:
        raise DataError(Message("the log has no magnetometer of three axes; name its columns with {option.columns}"), code="no_mag")
    return fit(log.mag[np.isfinite(log.mag).all(axis=1)], **options)


def no_sensor() -> DataError:
    """The error for a log without a sensor whose noise could be looked at."""
    said = "the log holds neither gyroscope, accelerometer nor magnetometer; name their columns with {option.columns}"
    return DataError(Message(said), code="no_sensor")


def deviations(log: Log, name: str = "", **options: Any) -> Results[Any]:
    """Deviations of every channel of a log; `name` replaces those of the sensors."""
    from ..allan import Deviations, deviation

    found = {}
    for sensor in ("gyro", "accel", "mag"):
        if (values := getattr(log, sensor)) is not None:
            result = deviation(*at_own_rate(values.reshape(len(values), -1), log.rate), **options)
            found |= {f"{name or sensor}_{'xyz'[axis]}": result.channel(axis) for axis in range(result.deviation.shape[1])}
    if not found:
        raise no_sensor()
    return Deviations(found, unrest(log))


#: name of a task -> the function whose options it takes, and what is called with the log: a function, or the place of one
TASKS: dict[str, tuple[str, str | Callable[..., Any]]] = {
    "noise": ("noise.characterise", "noise.characterise"), "mag": ("magnetometer.fit", mag),
    "imu": ("imu.multi_position", "imu.multi_position"), "temperature": ("temperature.fit", "temperature.characterise"),
    "allan": ("allan.deviation", deviations),
}  # fmt: skip


def _public(place: str) -> Callable[..., Any]:
    """A public function of jaxcal, such as "noise.fit"."""
    part, _, function = place.partition(".")
    return getattr(importlib.import_module(f"..{part}", __package__), function)


def check_task(task: Any, options: dict[str, Any]) -> None:
    """Raise a `DataError` unless the task is known and accepts these options."""
    if not isinstance(task, str):
        if not callable(task):
            raise DataError(f"task must be one of {', '.join(TASKS)}, or a function Log -> result; got {task!r}", code="task")
        return
    if task not in TASKS:
        raise DataError(f"there is no task {task!r}; expected one of {', '.join(TASKS)}, or a function Log -> result", code="task")
    parameters = inspect.signature(_public(TASKS[task][0])).parameters.values()
    known = [each.name for each in parameters if each.kind is each.KEYWORD_ONLY and each.name not in ("progress", "time", "data", "rate")]
    unknown = [name for name in options if name not in known]
    if unknown:
        raise DataError(f"task {task!r} has no option {', '.join(unknown)}; it takes {', '.join(known)}", code="option")


def answer_of(result: Any, log: Log) -> tuple[Any, dict[str, Number], list[Any]]:
    """The document of a result, its numbers, and its findings.

    Numbers that an option or convention holds are left out, and so are details without an interval or limit: they describe the log, not
    the device, such as the length of record that a coefficient needs. A new field of a model, a new number or a new finding needs nothing
    here.

    Raises
    ------
    DataError
        If the result is refused.
    """
    if result.verdict == "refused":
        raise DataError(f"the result is refused. {result.reason}", code="refused")
    sections = result.sections()
    details = numbers_of(one for one in sections if isinstance(one, Grid) and one.detail)
    numbers = {
        name: one for name, one in numbers_of(sections).items()
        if one.state != "held" and (name not in details or one.low < one.high or one.state == "limit")
    }  # fmt: skip
    # a limit has no value of its own
    found = {name: one._replace(value=math.nan) if one.state == "limit" else one for name, one in numbers.items()}
    return result._document(log, sections), found, list(result.findings)


def perform(task: Any, log: Log, options: dict[str, Any], page: str | None = None) -> dict[str, Any]:
    """Perform the task: the result as in JSON, its numbers, and findings. A report of it is written to `page`."""
    if isinstance(task, str):
        still = task in ("noise", "allan")
        log = log.cleaned(still, left=() if still else ("clipped", "zeroed"))
        if wrong := unsuited(task, log, str(log.provenance.get("file", "LOG"))):
            raise DataError(wrong, code="unsuited")
        called = TASKS[task][1]
        task = functools.partial(_public(called) if isinstance(called, str) else called, **options)
    result = task(log)
    ours = isinstance(result, Result | Results)
    document, found, said = answer_of(result, log) if ours else (own := plain(result), _numbers(own), [])
    if ours and page is not None:
        from ..report import write

        write(result, page, log=log)
    findings = [one if isinstance(one, Finding) else FINDINGS("said", text=one) for one in (*log.findings, *said)]
    kept = [{key: one.to_dict()[key] for key in ("code", "severity", "subject", "text")} for one in ordered(dict.fromkeys(findings))]
    return {"findings": kept, "numbers": plain({name: one.to_dict() for name, one in found.items()}), "result": document}


def _numbers(result: Any, name: str = "") -> dict[str, Number]:
    """The first numbers in the result of a user's task: a.b for nested dictionaries, a[0] for short lists."""
    if isinstance(result, bool) or not isinstance(result, int | float | dict | list):
        return {}
    if isinstance(result, int | float):
        return {name or "value": Number(name or "value", float(result), quantity="")}
    if isinstance(result, dict):
        items = [(f"{name}.{key}" if name else str(key), item) for key, item in result.items()]
    else:
        items = [(f"{name}[{i}]", item) for i, item in enumerate(result)] if len(result) <= 12 else []
    return dict(pair for key, item in items for pair in _numbers(item, key).items())


def identity(task: Any, options: dict[str, Any], reading: dict[str, Any]) -> dict[str, Any]:
    """Everything besides the log on which a result depends; a result with the same identity is not computed again.

    A user's function is identified by its name and, if Python has it, its source.
    """
    return {**_named(task), "options": plain(options), "reading": plain(reading), "jaxcal": version_of("jaxcal")}


def _named(task: Any) -> dict[str, Any]:
    if isinstance(task, str):
        return {"name": task}
    if isinstance(task, functools.partial):
        inner = _named(task.func)
        return {**inner, "arguments": plain([task.args, task.keywords])}
    function = task if hasattr(task, "__qualname__") else type(task)
    try:
        source = hashlib.sha256(inspect.getsource(function).encode()).hexdigest()[:16]
    except (OSError, TypeError):
        source = None
    return {"name": f"{function.__module__}.{function.__qualname__}", "source": source}


def reading_options(reading: dict[str, Any]) -> tuple[dict[str, Any], tuple[Any, Any]]:
    """Options of `jaxcal.read`, and start and stop of the part to use; a `DataError` for options that are unknown or invalid."""
    from ..io import read
    from ..io._columns import parse_axes, parse_columns, parse_topics, parse_units

    known = [name for name in inspect.signature(read).parameters if name not in ("path", "quiet")]
    unknown = [name for name in reading if name not in (*known, "start", "stop")]
    if unknown:
        raise DataError(f"no reading option {', '.join(unknown)}; known are {', '.join([*known, 'start', 'stop'])}", code="reading")
    for name, parse in (("columns", parse_columns), ("units", parse_units), ("topics", parse_topics), ("axes", parse_axes)):
        try:
            parse(reading.get(name))
        except UnitError as error:
            raise DataError(Message("reading option {name}: {error}", name=name, error=error), code=error.code) from error
    return {name: value for name, value in reading.items() if name in known}, (reading.get("start"), reading.get("stop"))
