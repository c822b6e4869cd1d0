"""HDF5, and MATLAB 7.3, which is HDF5, through h5py in a process of its own (see `_apart`).

Only what lies in the file itself is read: links to other files, data stored in them, and virtual data sets are left out.
"""

import importlib.util
import pathlib

from .._errors import DataError
from ._apart import apart
from ._bounds import allowed, check_declared
from ._table import Table
from ._tree import table_of_tree


def read_hdf5(path: pathlib.Path, topics: list[str] | None) -> Table:
    """Arrays of an HDF5 file by the names of the data sets, at any depth; an attribute `units` gives the unit."""
    if importlib.util.find_spec("h5py") is None:
        raise DataError('reading HDF5 and MATLAB 7.3 needs h5py: pip install "jaxcal[hdf5]"')
    size = path.stat().st_size
    about, arrays = apart.read("hdf5", str(path), allowed=allowed(size))
    if "most" in about:
        raise DataError(f"the file holds more than {about['most']} data sets; it is damaged, or no log: save the log's arrays alone")
    if "declared" in about:
        check_declared(about["declared"], size, "the file")
    named = {name: array.astype(array.dtype.newbyteorder("=")) for name, array in zip(about["names"], arrays, strict=True)}
    left_out = [
        f"{name} is a MATLAB {kind or 'object'}; save it as a struct of arrays (table2struct(T, 'ToScalar', true))"
        for name, kind in about["opaque"]
    ]
    try:
        table = table_of_tree(named, topics, "data set", about["units"])
    except DataError as error:
        raise DataError(f"{error}; not read: {'; '.join(left_out)}") if left_out else error from None
    table.notes += left_out
    return table
