"""Find the files of a recording and detect their format."""

import contextlib
import pathlib
import re
import struct

from .._errors import DataError
from ._archive import zip_kind
from ._columns import SENSORS
from ._names import parse
from ._readers._bounds import MOST
from ._triples import file_kind

#: supported formats, as named in `format=`
FORMATS = ("csv", "npy", "npz", "parquet", "rosbag1", "rosbag2", "mat", "hdf5", "ulog", "dataflash", "zip", "json", "xlsx", "tdms")

_SQLITE, _MCAP, _HDF5 = b"SQLite format 3\0", b"\x89MCAP0\r\n", b"\x89HDF\r\n\x1a\n"
_MAGIC = {
    b"\x93NUMPY": "npy", b"PK\x03\x04": "zip", b"PK\x05\x06": "zip", b"PAR1": "parquet", b"#ROSBAG V": "rosbag1", _SQLITE: "rosbag2",
    _MCAP: "rosbag2", _HDF5: "hdf5", b"MATLAB 7.3": "hdf5", b"MATLAB 5.0": "mat", b"ULog\x01\x12\x35": "ulog", b"\xa3\x95": "dataflash",
    b"\xd0\xcf\x11\xe0": "xlsx", b"TDSm": "tdms",
}  # fmt: skip
#: suffixes of text tables; other text files (notes, configuration) are not logs
_TEXT = (".csv", ".tsv", ".txt", ".dat", ".csv.gz", ".tsv.gz", ".txt.gz", ".dat.gz")
_PART = re.compile(r"(.+)_(\d+)")
#: words that differ between files of the same sensor: Accelerometer, AccelerometerUncalibrated, TotalAcceleration
_VARIANT = re.compile(r"uncalibrated|uncal|total|raw|calibrated|accelerometer|acceleration|accel|acc|[^a-z0-9]")
_LFS = b"version https://git-lfs.github.com/spec/"
_SHOWN = 8
#: first bytes of files that are not read, or their suffix, what they are, and the program that makes a log of them
_OTHERS = (
    ((b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05"), "a pickle, which can run any program", "save the arrays with numpy.savez"),
    ((b"ARROW1", b"FEA1"), "an Arrow (Feather) file", "save it as Parquet"),
    ((b"H Product:Blackbox", ".bbl", ".bfl"), "a blackbox log of Betaflight or iNav", "run `blackbox_decode LOG`"),
    ((".tlog",), "telemetry of MAVLink", "give the .bin log, or run `mavlogdump.py --format csv --types RAW_IMU LOG > imu.csv`"),
    ((b"MD\xfc\x03", ".cwa"), "a log of Axivity (CWA)", "export CSV with OmGui, or run `cwa-convert LOG -out log.csv`"),
    ((b"Device Identity",), "a log of GENEActiv", "export CSV with the GENEActiv software"),
    ((".gt3x",), "a log of ActiGraph (GT3X)", "export CSV with ActiLife, or with pygt3x"),
    ((b"RDX2", b"RDX3", ".rda", ".rdata", ".rds"), "data of R", "write it in R: write.csv(x, 'log.csv', row.names = FALSE)"),
    ((b"%RAWIMU", b"#RAWIMU", b"\xaa\x44\x12", b"\xaa\x44\x13"), "a log of NovAtel", "export it as CSV with NovAtel Application Suite"),
    ((b"\xfa\xff", ".mtb"), "a log of Xsens (MTB)", "export it as text with MT Manager"),
    ((".mp4", ".mov", ".360", ".insv"), "a video", "extract its motion data as CSV, as with gpmf-extract or Gyroflow"),
    ((b"7z\xbc\xaf", b"Rar!", b"\xfd7zXZ", b"BZh", b"\x28\xb5\x2f\xfd"), "a packed file of a kind that is not unpacked", "unpack it"),
    ((b"%PDF", b"\x89PNG", b"\xff\xd8\xff", b"GIF8", b"RIFF"), "a document, picture or sound", "give the log itself"),
)
_PAGE = re.compile(rb"\s*(?:<!doctype html|<html|<\?xml|404: not found|<!--)", re.IGNORECASE)
_JSON = re.compile(rb"\s*(?:\[\s*)?\{\s*[\"}]")


def find(path: pathlib.Path) -> tuple[str, list[pathlib.Path]]:
    """Format and files of a log: one file, the parts of a split ROS recording in order, or one file for each sensor ("sensors")."""
    if not path.is_dir():
        return detect(path), [path]
    if (path / "metadata.yaml").is_file():
        return "rosbag2", [path]
    logs: dict[pathlib.Path, str] = {}
    refused = ""
    for i, file in enumerate(sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))):
        if i == MOST:
            raise DataError(f"the folder holds more than {MOST} files; give one log", code="not_a_log")
        try:
            kind = detect(file)
        except (DataError, OSError) as error:
            refused = refused or (f"{file.name}: {error}" if getattr(error, "code", "") == "lfs" else "")
            continue
        # JSON beside a log describes the log
        if kind != "json" and (kind != "csv" or file.name.lower().endswith(_TEXT)):
            logs[file] = kind
    if not logs:
        raise DataError(refused or "no readable log and no ROS 2 recording (metadata.yaml) in it; give a log file", code="not_a_log")
    files, kinds = list(logs), set(logs.values())
    if len(files) == 1:
        return kinds.pop(), files
    if kinds in ({"rosbag1"}, {"rosbag2"}):
        return kinds.pop(), _parts(files)
    if kinds == {"csv"} and (sensors := sensor_files(files)):
        return "sensors", sensors
    shown = ", ".join(file.name for file in files[:_SHOWN]) + f" and {len(files) - _SHOWN} more" * (len(files) > _SHOWN)
    raise DataError(f"the folder holds {len(files)} logs, each a recording of its own: {shown}; give one of them", code="several_logs")


def sensor_files(files: list[pathlib.Path]) -> list[pathlib.Path]:
    """The files of a folder with one sensor each, according to their names; empty if a sensor was recorded twice."""
    found: dict[str, list[str]] = {}
    kept = []
    for file in files:
        kind = file_kind(file.name.partition(".")[0])
        if kind in SENSORS or (kind is None and _names_sensors(file)):
            kept.append(file)
        if kind in SENSORS:
            found.setdefault(kind, []).append(re.sub(_VARIANT, "", file.name.lower()))
    return [] if len(files) < 2 or not found or any(len(set(names)) > 1 for names in found.values()) else kept


def _names_sensors(file: pathlib.Path) -> bool:
    """Whether the beginning of a text file names an axis of a sensor."""
    with contextlib.suppress(OSError), file.open("rb") as opened:
        words = re.split(r"[,;\t\n]", opened.read(2048).decode("utf-8", "replace"))
        return any((one := parse(word.strip('" #\r'))) is not None and one.kind in SENSORS for word in words if word.strip())
    return False


def _parts(files: list[pathlib.Path]) -> list[pathlib.Path]:
    """Sort the parts of one recording: name_0, name_1, ... from `rosbag record --split` and `ros2 bag record -b`."""
    matches = {file: _PART.fullmatch(file.stem) for file in files}
    found = {int(match[2]): file for file, match in matches.items() if match}
    stems = {(match[1], file.suffix) if match else (file.name, "") for file, match in matches.items()}
    if len(stems) > 1 or len(found) < len(files):
        mend = " run `ros2 bag reindex` on it, or" if files[0].suffix != ".bag" else ""
        raise DataError(f"it holds {len(files)} parts of a recording but no metadata.yaml;{mend} give one part", code="part_missing")
    missing = sorted(set(range(max(found) + 1)) - set(found))
    if missing:
        name = f"{next(iter(stems))[0]}_{missing[0]}{files[0].suffix}"
        raise DataError(f"of the parts of a recording in it {name} is missing; put it there, or give one part", code="part_missing")
    return [found[number] for number in sorted(found)]


def detect(path: pathlib.Path) -> str:
    """Detect the format of a file from its first bytes."""
    if not path.exists():
        raise DataError("there is no such file; check the path", code="no_file")
    if not path.is_file():
        raise DataError("this is not a regular file; save the data in one and give its path", code="not_a_log")
    if not path.stat().st_size:  # nor are files of the kernel opened, which block and have no size
        raise DataError("the file is empty", code="empty")
    with path.open("rb") as file:
        head = file.read(4096)
    if head.startswith(_LFS):
        size = re.search(rb"size (\d{1,18})", head)
        held = f" of {int(size[1])} bytes" if size else ""
        raise DataError(f"a Git LFS pointer, not the recording{held}: run `git lfs pull` in the repository", code="lfs")
    suffix = path.suffix.lower()
    _refuse_others(head, suffix)
    for magic, kind in _MAGIC.items():
        if head.startswith(magic):
            wanted = {_SQLITE: ".db3", _MCAP: ".mcap"}.get(magic, path.suffix)
            if path.suffix != wanted:
                raise DataError(f"this is a ROS 2 recording, but its name does not end in {wanted}; rename it", code="not_a_log")
            return zip_kind(path) if kind == "zip" else kind
    if _HDF5 in head:  # after a user block, as in MATLAB 7.3
        return "hdf5"
    if suffix == ".mat" and _is_mat4(head):
        return "mat"
    if suffix in (".npz", ".npy", ".parquet", ".mcap", ".db3", ".bag", ".ulg", ".mat", ".h5", ".hdf5"):
        raise DataError(f"it does not begin as files {path.suffix} do; it is damaged, or misnamed", code="not_a_log")
    return "json" if suffix == ".json" or _JSON.match(head) else "csv"


def _refuse_others(head: bytes, suffix: str) -> None:
    """Refuse a file that is not a log, and say what it is."""
    for marks, what, advice in _OTHERS:
        if any(head.startswith(mark) if isinstance(mark, bytes) else mark == suffix for mark in marks):
            raise DataError(f"this is {what}: {advice}, and read that", code="not_a_log")
    if _PAGE.match(head):
        raise DataError("a page of the web or XML, not the log: download the file as it is (on GitHub: Raw)", code="not_a_log")


def _is_mat4(head: bytes) -> bool:
    """Whether a file begins like MATLAB 4: a type of four decimal digits, and plausible sizes."""
    found = [struct.unpack(order + "5i", head[:20].ljust(20, b"\xff")) for order in "<>"]
    return any(kind % 1000 < 60 and 0 <= kind < 2000 and min(a, b) >= 0 and i in (0, 1) and 0 < n < 256 for kind, a, b, i, n in found)
