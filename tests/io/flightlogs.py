"""Writers of PX4 ULog and ArduPilot DataFlash logs, which follow the published formats byte by byte."""

import struct

import numpy as np


def ulog_message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


class ULogWriter:
    """Writer of a ULog file: formats, parameters, then messages, in the order of the calls; `content` has the bytes of the file."""

    def __init__(self, start=0):
        self.content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", start) + ulog_message("B", bytes(40))
        self.numbers = {}

    def format(self, name, fields):
        self.content += ulog_message("F", f"{name}:{';'.join(fields)};".encode())

    def parameter(self, name, value):
        kind, code = ("int32_t", "i") if isinstance(value, int) else ("float", "f")
        key = f"{kind} {name}".encode()
        self.content += ulog_message("P", bytes([len(key)]) + key + struct.pack("<" + code, value))

    def subscribe(self, name, instance=0):
        number = len(self.numbers)
        self.numbers[name, instance] = number
        self.content += ulog_message("A", struct.pack("<BH", instance, number) + name.encode())

    def data(self, name, instance, rows, cut=0):
        """Write the rows of a structured array without the last `cut` bytes of each, which are padding."""
        packed = np.ascontiguousarray(rows)
        size = packed.dtype.itemsize
        raw = packed.tobytes()
        head = struct.pack("<HBH", size - cut + 2, ord("D"), self.numbers[name, instance])
        self.content += b"".join(head + raw[i : i + size - cut] for i in range(0, len(raw), size))

    def dropout(self, ms):
        self.content += ulog_message("O", struct.pack("<H", ms))

    def sync(self):
        self.content += ulog_message("S", b"\x2f\x73\x13\x20\x25\x0c\xbb\x12")


SENSOR = ["uint64_t timestamp", "uint64_t timestamp_sample", "uint32_t device_id", "float x", "float y", "float z", "float temperature",
          "uint32_t error_count", "uint8_t[3] clip_counter", "uint8_t samples", "uint8_t[4] _padding0"]  # fmt: skip


def dtype_of(fields):
    kinds = {"uint64_t": "<u8", "float": "<f4", "uint32_t": "<u4", "int32_t": "<i4", "uint8_t": "u1", "int16_t": "<i2"}
    found = []
    for field in fields:
        kind, name = field.split(" ")
        base, _, count = kind.partition("[")
        found.append((name, kinds[base], (int(count[:-1]),)) if count else (name, kinds[base]))
    return np.dtype(found)


def sensor_rows(stamps_us, values, device=1310988, temperature=25.0):
    rows = np.zeros(len(stamps_us), dtype_of(SENSOR))
    rows["timestamp_sample"] = stamps_us
    rows["timestamp"] = np.asarray(stamps_us) + 350
    rows["device_id"], rows["temperature"], rows["samples"] = device, temperature, 8
    rows["x"], rows["y"], rows["z"] = np.asarray(values).T
    return rows


DATAFLASH_CODES = {
    "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "q": "q", "Q": "Q", "f": "f", "d": "d", "n": "4s", "N": "16s", "Z": "64s",
    "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "a": "32h",
}  # fmt: skip


class DataFlashWriter:
    """Writer of a DataFlash file: an FMT record for every type, then records; `content` has the bytes of the file."""

    def __init__(self):
        self.content = b""
        self.formats = {}
        self.describe(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")

    def describe(self, number, name, letters, labels):
        code = "<" + "".join(DATAFLASH_CODES[letter] for letter in letters)
        self.formats[name] = (number, code)
        length = struct.calcsize(code) + 3
        self.content += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, name.encode(), letters.encode(), labels.encode())

    def record(self, name, *values):
        number, code = self.formats[name]
        values = [v.encode() if isinstance(v, str) else v for v in values]
        return b"\xa3\x95" + bytes([number]) + struct.pack(code, *values)

    def write(self, name, *values):
        self.content += self.record(name, *values)

    def write_all(self, name, rows):
        self.content += b"".join(self.record(name, *row) for row in rows)


IMU_LABELS = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"


def imu_records(stamps_us, gyro, accel, instance=0, temperature=25.0):
    for t, w, f in zip(stamps_us, gyro, accel, strict=True):
        yield (int(t), instance, *map(float, w), *map(float, f), 0, 0, temperature, 1, 1, 1000, 1000)


def dataflash_with_imu(stamps_us, gyro, accel, instances=(0,)):
    """A log with FMT records, as ArduPilot writes them first, and then alternating IMU records of the instances."""
    log = DataFlashWriter()
    log.describe(176, "IMU", "QBffffffIIfBBHH", IMU_LABELS)
    log.describe(64, "PARM", "QNf", "TimeUS,Name,Value")
    parts = [[log.record("IMU", *row) for row in imu_records(stamps_us, gyro, accel, i)] for i in instances]
    log.content += b"".join(record for records in zip(*parts, strict=True) for record in records)
    return log


def ulog_with_imu(stamps_us, gyro, accel, mag=None, instances=(0,)):
    """A log of raw sensor topics, with one row of each topic in turn."""
    log = ULogWriter()
    for name in ("sensor_gyro", "sensor_accel", "sensor_mag"):
        log.format(name, SENSOR)
    log.parameter("SYS_AUTOSTART", 4001)
    sources = [("sensor_gyro", gyro), ("sensor_accel", accel), *([("sensor_mag", mag)] if mag is not None else [])]
    pieces = []
    for name, values in sources:
        for instance in instances:
            log.subscribe(name, instance)
            rows = sensor_rows(stamps_us, values, 1310988 + instance)
            head = struct.pack("<HBH", rows.dtype.itemsize - 4 + 2, ord("D"), log.numbers[name, instance])
            raw, size = rows.tobytes(), rows.dtype.itemsize
            pieces.append([head + raw[i : i + size - 4] for i in range(0, len(raw), size)])
    log.content += b"".join(message for messages in zip(*pieces, strict=True) for message in messages)
    return log


def f4(values):
    """Numbers rounded to single precision, as a flight log stores them."""
    return values.astype(np.float32).astype(np.float64)
