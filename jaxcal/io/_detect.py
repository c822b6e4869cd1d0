"""Which format a path holds, by its first bytes."""

import pathlib

from .._errors import DataError

#: formats that are read, as `format=` names them
FORMATS = ("csv", "npy", "npz", "parquet", "rosbag1", "rosbag2")

_MAGIC = (
    (b"\x93NUMPY", "npy"),
    (b"PK\x03\x04", "npz"),
    (b"PK\x05\x06", "npz"),
    (b"PAR1", "parquet"),
    (b"#ROSBAG V", "rosbag1"),
    (b"SQLite format 3\0", "rosbag2"),
    (b"\x89MCAP0\r\n", "rosbag2"),
)
_UNREAD = (
    (b"\x89HDF", "an HDF5 file (or MATLAB 7.3)", "export its arrays to .npz, Parquet or CSV"),
    (b"MATLAB 5.0", "a MATLAB file", "save it as .npz with scipy.io.loadmat and numpy.savez, or as CSV with writematrix"),
    (b"MATLAB 7.3", "a MATLAB 7.3 file", "export its arrays to .npz or CSV"),
    (b"ULog\x01\x12\x35", "a PX4 ULog", "convert it with `ulog2csv` of pyulog"),
    (b"\xa3\x95", "an ArduPilot DataFlash log", "convert it to CSV with `mavlogdump.py --format csv --types IMU`"),
)


def detect(path: pathlib.Path) -> tuple[str, pathlib.Path]:
    """Format of a file or folder, and the path to read.

    Raises
    ------
    DataError
        If there is nothing readable at `path`, or its format is known but not read.
    """
    if path.is_dir():
        return "rosbag2", _bag_in(path)
    if not path.exists():
        raise DataError("there is no such file; check the path")
    if not path.is_file():
        raise DataError("this is not a regular file; save the data in one and give its path")
    with path.open("rb") as file:
        head = file.read(32)
    if not head:
        raise DataError("the file is empty")
    for magic, kind in _MAGIC:
        if head.startswith(magic):
            wanted = {b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}.get(magic)
            if wanted and path.suffix != wanted:
                raise DataError(f"this is a ROS 2 recording, but its name does not end in {wanted}; rename it")
            return kind, path
    for magic, what, mend in _UNREAD:
        if head.startswith(magic):
            raise DataError(f"this is {what}, which is not read; {mend}")
    if path.suffix.lower() in (".npz", ".npy", ".parquet", ".mcap", ".db3", ".bag"):
        raise DataError(f"the name ends in {path.suffix}, but the file does not begin as such a file does; it is damaged, or misnamed")
    return "csv", path


def _bag_in(folder: pathlib.Path) -> pathlib.Path:
    if (folder / "metadata.yaml").is_file():
        return folder
    files = sorted(file for file in folder.iterdir() if file.suffix in (".mcap", ".db3"))
    if len(files) == 1:
        return files[0]
    if files:
        raise DataError(
            f"the folder holds {len(files)} parts of a recording but no metadata.yaml; run `ros2 bag reindex` on it, or give one part"
        )
    raise DataError("the folder holds no ROS 2 recording (no metadata.yaml, .mcap or .db3); give a log file")
