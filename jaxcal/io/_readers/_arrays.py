"""Read files of arrays: NumPy, MATLAB, HDF5 and Parquet. Pickled objects are never loaded."""

import pathlib
import posixpath
import re
import zipfile
from typing import Any

import numpy as np

from ..._errors import DataError
from ..._message import Message, joined_messages
from ..._units import si_unit
from .._columns import AXES, SENSORS, wrong
from .._findings import READ
from .._names import parse_name
from .._saved import parse_saved
from .._table import Table
from .._triples import file_kind
from ._bounds import MOST, allowed, check_declared, require
from ._sandbox import sandbox
from ._streams import SeveralError

_RATE = {
    "rate", "fs", "samplerate", "samplingrate", "freq", "frequency", "samplingfrequency", "samplefrequency", "sampfreq", "sfreq", "odr",
    "samplingratehz", "fshz", "ratehz", "updaterate", "outputrate", "imurate", "datarate",
}  # fmt: skip
_NAMELESS = "\0"


# arrays side by side


def read_npy(path: pathlib.Path) -> Table:
    """Read the columns of a 2-D array (memory-mapped), or the fields of a structured array."""
    return arrays_of_columns(np.load(path, mmap_mode="r", allow_pickle=False))


def arrays_of_columns(array: np.ndarray) -> Table:
    """Make a table from the columns of a 2-D array, or from the fields of a structured array."""
    if array.dtype.names:
        return table_of_arrays({name: array[name] for name in array.dtype.names})
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or array.dtype.kind not in "iufb":
        raise DataError(f"shape {array.shape}, type {array.dtype}; expected numbers of shape (samples, columns)", code="shape")
    if array.shape[0] < array.shape[1]:
        raise DataError(f"the array has shape {array.shape}; time is the first axis: transpose it before saving", code="shape")
    return _table(list(array.T), [""] * array.shape[1])


def read_npz(path: pathlib.Path) -> Table:
    """Read the arrays of an .npz by name: vectors such as gyro (n, 3), channels such as gyro_x (n,), and a scalar rate."""
    with zipfile.ZipFile(path) as archive:
        check_declared(sum(member.file_size for member in archive.infolist()), path.stat().st_size, "the arrays")
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    saved = arrays.pop("jaxcal", None)
    system = arrays.pop("units", np.array(""))
    arrays |= {name: array.T for name, array in arrays.items() if array.ndim == 2 and array.shape[0] < array.shape[1]}
    table = table_of_arrays(arrays)
    if str(system) == "SI":  # written by `jaxcal apply` and `jaxcal simulate`
        quantities = [(parse_name(name) or ("",))[0] for name in table.names]
        table.names = [f"{name} [{si_unit(one)}]" if one else name for name, one in zip(table.names, quantities, strict=True)]
    if saved is not None and saved.dtype.kind == "U" and saved.size == 1:
        table.saved = parse_saved(str(saved.reshape(())))
    return table


def read_parquet(path: pathlib.Path) -> Table:
    """Read the columns of a Parquet file, named as in a text table; dates and times become datetime64[ns]."""
    require("polars", "reading Parquet", "parquet")
    about, arrays = _in_sandbox("parquet", path, "the table")
    columns = []
    for form, array in zip(about["columns"], arrays, strict=True):
        if form["dates"]:
            array = array.view("datetime64[ns]")
        elif form["words"]:
            array = np.array(form["words"], dtype=object)[array]
        columns.append(array)
    integer = {j for j, form in enumerate(about["columns"]) if form["integer"]}
    saved = about["saved"] and parse_saved(about["saved"])
    return Table(columns, [form["name"] for form in about["columns"]], integer, saved=saved)


def table_of_arrays(arrays: dict[str, np.ndarray]) -> Table:
    """Make a table from arrays of one length: vectors of up to three columns, and single channels; a scalar may be the rate."""
    columns: list[np.ndarray] = []
    names: list[str] = []
    rate, left_out = None, []
    n = max((len(array) for array in arrays.values() if array.ndim in (1, 2)), default=0)
    for name, array in arrays.items():
        if array.size == 1 and _is_rate(name) and array.dtype.kind in "iuf":
            rate = float(array.reshape(()))
        elif array.ndim == 1 and len(array) == n:
            columns.append(array)
            names.append(name)
        elif array.ndim == 2 and len(array) == n and 1 <= array.shape[1] <= 3:
            columns += list(array.T)
            names += [f"{name}_{axis}" for axis in AXES[: array.shape[1]]]
        else:
            left_out.append(f"{name} {array.shape}")
    if not columns or n < 1:
        shapes = {name: array.shape for name, array in arrays.items()}
        said = f"no arrays of shape (n,) or (n, 3) of one length: {shapes}; use the keys time, gyro, accel, mag, temperature"
        raise DataError(said, code="shape")
    table = _table(columns, names)
    table.rate = rate
    if left_out:
        table.findings.append(READ("not_read", what=f"arrays whose shape is not that of {n} samples: {', '.join(left_out)}"))
    return table


def _is_rate(name: str) -> bool:
    return re.sub(r"[^a-z]", "", name.lower()) in _RATE


def _table(columns: list[np.ndarray], names: list[str]) -> Table:
    heads = [column[:10_000] for column in columns]
    whole = [head.dtype.kind in "iu" or (head.dtype.kind == "f" and np.array_equal(head, np.round(head))) for head in heads]
    return Table(columns, names, {j for j, integer in enumerate(whole) if integer})


# arrays in places: variables, structs, groups


def read_mat(path: pathlib.Path, topics: list[str] | None) -> dict[str, Table]:
    """Read the variables, and fields of structs, of a MATLAB file of version 4 to 7; version 7.3 is HDF5."""
    about, arrays = _in_sandbox("mat", path, "the file")
    if not about["names"] and about["opaque"]:
        struct = "S = table2struct(T, 'ToScalar', true); save log.mat -struct S"
        raise DataError(f"it holds MATLAB objects (table, timetable), which are not public; save a struct ({struct})", code="no_sensor")
    return _tables_of_tree(about, arrays, topics, "variable")


def read_tdms(path: pathlib.Path, topics: list[str] | None) -> dict[str, Table]:
    """Read the channels of a LabVIEW TDMS file, with their units and the rate of their waveforms."""
    require("nptdms", "reading TDMS", "tdms")
    return _rated(_in_sandbox("tdms", path, "the file"), topics, "channel")


def read_hdf5(path: pathlib.Path, topics: list[str] | None) -> dict[str, Table]:
    """Read the arrays of an HDF5 or MATLAB 7.3 file by the names of the data sets, at any depth; an attribute `units` gives the unit.

    Only data in the file itself are read: links to other files, external data, and virtual data sets are left out.
    """
    require("h5py", "reading HDF5 and MATLAB 7.3", "hdf5")
    about, arrays = _in_sandbox("hdf5", path, "the file")
    if about.get("many"):
        raise DataError(f"the file holds more than {MOST} data sets; it is damaged, or no log: save the log's arrays alone", code="shape")
    mend = "save it as a struct of arrays (table2struct(T, 'ToScalar', true))"
    left_out = [f"{name} is a MATLAB {kind or 'object'}; {mend}" for name, kind in about["opaque"]]
    try:
        tables = _rated((about, arrays), topics, "data set")
    except DataError as error:
        if left_out and not isinstance(error, SeveralError):
            raise DataError(joined_messages([error, f"not read: {'; '.join(left_out)}"]), error.code) from None
        raise
    next(iter(tables.values())).findings.extend(READ("not_read", what=what) for what in left_out)
    return tables


def _rated(found: tuple[dict[str, Any], list[np.ndarray]], topics: list[str] | None, kind: str) -> dict[str, Table]:
    """The tables of a tree, with the rate that one attribute states."""
    tables, about = _tables_of_tree(*found, topics, kind), found[0]
    table = next(iter(tables.values()))
    rates = {value for name, value in about.get("attributes", {}).items() if _is_rate(posixpath.basename(name))}
    if table.rate is None and len(rates) == 1 and next(iter(rates)) > 0:
        table.rate = rates.pop()
    return tables


def _in_sandbox(kind: str, path: pathlib.Path, what: str) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Read description and arrays of a file in the separate process of `_sandbox`."""
    size = path.stat().st_size
    about, arrays = sandbox.read(kind, str(path), allowed=allowed(size), most=MOST)
    check_declared(about.get("declared", 0), size, what)
    return about, arrays


def _tables_of_tree(about: dict[str, Any], arrays: list[np.ndarray], topics: list[str] | None, kind: str) -> dict[str, Table]:
    """Make a table from the arrays of one group, or from all arrays if their names are unique; or one for each group of a sensor.

    `about` has the names of the arrays, such as ``imu0/gyro``, and units by name if the file states them. Arrays may be transposed: the
    longer side is time. `topics` is the group to read, `kind` the word for an array in messages.
    """
    groups: dict[str, dict[str, np.ndarray]] = {}
    for path, array in zip(about["names"], arrays, strict=True):
        if array.size:
            unit = about.get("units", {}).get(path)
            group, name = posixpath.split(path)
            name += f" [{unit}]" if unit else ""
            groups.setdefault(group, {})[name] = _upright(array.astype(array.dtype.newbyteorder("=")))
    for group in [group for group, one in groups.items() if group and all(name.lower()[:2].strip() in AXES for name in one)]:
        for name, array in groups.pop(group).items():  # imu/acc/x is acc_x of imu
            groups.setdefault(posixpath.dirname(group), {})[f"{posixpath.basename(group)}_{name}"] = array
    if not groups:
        shown = [f"{path} {array.shape} {array.dtype}" for path, array in zip(about["names"][:12], arrays, strict=False)]
        said = f"no {kind} with numbers in it (there is {', '.join(shown) or 'nothing'}); save time, gyro, accel, mag as plain arrays"
        raise DataError(said, code="no_sensor")
    with_sensors = [name for name, group in groups.items() if _has_sensor(group)]
    if topics is not None:
        wanted = [topic.strip("/") for topic in topics]
        unknown = [topic for topic in wanted if topic not in groups]
        if unknown or len(wanted) > 1:
            raise wrong("topics", f"{', '.join(unknown or wanted)}: give one of the groups {_listed(with_sensors or list(groups))}")
        return {wanted[0]: _group_table(_inherited(groups, wanted[0]))}
    own = {group: sensor for group in groups if (sensor := file_kind(posixpath.basename(group))) in SENSORS}
    if len(own) > 1 and len(set(own.values())) == len(own) and own.keys() >= set(with_sensors):
        return {posixpath.basename(group): _group_table(_inherited(groups, group), own[group]) for group in own}
    if len(with_sensors) == 1:
        return {"": _group_table(_inherited(groups, with_sensors[0]))}
    names = [name for group in groups.values() for name in group]
    twice = {name for name in names if names.count(name) > 1}
    if twice and with_sensors:
        said = Message("several groups hold sensors: name one with {option.topics}: {groups}", groups=_listed(with_sensors))
        raise SeveralError(said, sorted(with_sensors))
    return {"": _group_table({name: array for group in groups.values() for name, array in group.items() if name not in twice})}


def _inherited(groups: dict[str, dict[str, np.ndarray]], group: str) -> dict[str, np.ndarray]:
    """Arrays of a group and of its parent groups, which may have a clock that several sensors share, or a clock in a group of its own."""
    inside = (pair for name, one in groups.items() if name.startswith(group) for pair in one.items())
    clocks = {name: array for name, array in inside if (one := parse_name(name)) and one[0] == "time"}
    found = groups[group] | {name: array for name, array in clocks.items() if name not in groups[group]}
    while group:
        group = posixpath.dirname(group)
        found = groups.get(group, {}) | found
    return found


def _group_table(arrays: dict[str, np.ndarray], stem: str = "") -> Table:
    table = _columns_of(arrays)
    table.stem = stem
    return table


def _columns_of(arrays: dict[str, np.ndarray]) -> Table:
    matrices = [array for array in arrays.values() if array.ndim == 2 and array.shape[1] > 3]
    if len(matrices) != 1 or _has_sensor(arrays):
        return table_of_arrays(arrays)
    matrix = matrices[0]
    rest = {name: array for name, array in arrays.items() if array is not matrix and len(array) in (1, len(matrix))}
    table = table_of_arrays(rest | {f"{_NAMELESS}{j}": matrix[:, j] for j in range(min(matrix.shape[1], MOST))})
    table.names = ["" if name.startswith(_NAMELESS) else name for name in table.names]
    return table


def _has_sensor(arrays: dict[str, np.ndarray]) -> bool:
    names = [name for name, array in arrays.items() if array.ndim == 1]
    names += [f"{name}_{axis}" for name, array in arrays.items() if array.ndim == 2 for axis in AXES[: array.shape[1]]]
    return any((found := parse_name(name)) is not None and found[0] in (*SENSORS, "temperature") for name in names)


def _upright(array: np.ndarray) -> np.ndarray:
    """Make time the first axis: flatten vectors, and transpose matrices whose second side is longer."""
    if array.ndim != 1 and array.size == max(array.shape, default=1):
        return array.reshape(-1)
    return array.T if array.ndim == 2 and array.shape[0] < array.shape[1] else array


def _listed(groups: list[str]) -> str:
    return ", ".join(f"/{group}" for group in sorted(groups))
