"""`jaxcal mag --live`: readings of a serial port or of standard input, kept in a file, with a page that says what to turn to next.

The page is served on 127.0.0.1 alone. Its address holds a random token, and requests of other origins are refused.
"""

import contextlib
import http.server
import json
import math
import os
import re
import secrets
import select
import sys
import termios
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..magnetometer import guide
from ..report._html import MOST, evenly
from ..report._page import live_page
from ._options import CallError
from ._screen import Screen

_PERIOD = 0.1  # s between two looks at the readings, so that the page follows within 0.5 s on a busy machine too
_AXES = (("mx", "my", "mz"), ("x", "y", "z"))


def recorded(source: str, target: Path, baud: int, limit: float, inclination: float | None, screen: Screen, force: bool) -> Path:
    """Record readings until the error to expect is below `limit` (rad), the source ends, the page says stop, or Ctrl-C; return the log."""
    if target.exists() and not force:
        raise CallError(f"{target} exists already; name another file, or add --force", "exists")
    session = _Session(limit, inclination)
    with _opened(source, baud) as stream, _served(session) as address, target.open("w", encoding="utf-8") as log:
        screen.lines([f"recording {source} into {target}; Ctrl-C stops", f"open {address}"])
        screen.flush()
        reader = threading.Thread(target=session.read, args=(stream, log), daemon=True)
        reader.start()
        with contextlib.suppress(KeyboardInterrupt):
            while reader.is_alive() and not session.stopped.wait(_PERIOD):
                session.look()
        session.stopped.set()
        reader.join()
        session.look()
    screen.lines([f"{session.state['reason']} {len(session.readings)} readings, {session.skipped} lines that are none"])
    return target


def parsed(line: str) -> list[float] | None:
    """Three numbers a line, MotionCal's "Raw:" with its magnetometer in 0.1 uT at the end, or an object with mag, mx or x; else None."""
    text = line.strip()
    try:
        if text.startswith("{"):
            held = json.loads(text)
            names = next((names for names in _AXES if all(name in held for name in names)), ())
            values = held["mag"] if "mag" in held else [held[name] for name in names]
        elif text.startswith("Raw:"):
            values = [float(word) / 10 for word in text[4:].split(",")][6:9]
        else:
            values = re.split(r"[,;\s]+", text)
        found = [float(value) for value in values]
    except (ValueError, TypeError, KeyError):
        return None
    return found if len(found) == 3 and all(map(math.isfinite, found)) else None


class _Session:
    """What was read so far, and what the page shows."""

    def __init__(self, limit: float, inclination: float | None):
        self.limit, self.inclination = limit, inclination
        self.readings: list[list[float]] = []
        self.skipped, self.seen = 0, -1
        self.stopped = threading.Event()
        self.state: dict[str, Any] = {"count": 0, "reason": "no reading yet", "done": False, "sphere": None}

    def read(self, stream: int, log: Any) -> None:
        """Take lines until the source ends or the session stops, and write every reading to the log."""
        with contextlib.suppress(OSError):  # a port that is unplugged
            for line in self._lines(stream):
                values = parsed(line)
                if values is None:
                    self.skipped += 1
                    continue
                if not self.readings:
                    unit = " [uT]" if line.startswith("Raw:") else ""
                    log.write(f"mx{unit},my{unit},mz{unit}\n")  # no time: a pipe hands lines on in bursts
                log.write(f"{values[0]!r},{values[1]!r},{values[2]!r}\n")
                self.readings.append(values)

    def _lines(self, stream: int) -> Iterator[str]:
        """Lines as they come; a source that is silent does not keep the session from its end."""
        rest, part = b"", b""
        while not self.stopped.is_set():
            if select.select([stream], [], [], _PERIOD)[0]:
                part = os.read(stream, 65536)
                if not part:
                    break
                *whole, rest = (rest + part).split(b"\n")
                yield from (line.decode(errors="replace") for line in whole)
        if rest:
            yield rest.decode(errors="replace")

    def look(self) -> None:
        """Fit the readings so far; stop when the error is small enough."""
        number = len(self.readings)
        if number != self.seen and number:
            self.seen, m = number, np.array(self.readings[:number])
            found = guide(m, limit=self.limit, inclination=self.inclination)
            error = math.degrees(found.heading_error) if math.isfinite(found.heading_error) else None
            self.state = {"count": number, "reason": found.reason, "error": error, "sphere": _sphere(m, found)}
            if found.stop:
                self.stopped.set()
        self.state |= {"done": self.stopped.is_set()}


def _sphere(m: Any, found: Any) -> dict[str, Any]:
    """The readings, and the direction to turn to, as the sphere of a report shows them."""
    pick = np.array(evenly(len(m), MOST))
    if found.fit is not None and found.fit.model is not None:
        fixed = np.asarray(found.fit.model.correct(m[pick])) / found.fit.field
        residual = np.linalg.norm(fixed, axis=1) - 1.0
    else:
        away = m[pick] - m.mean(axis=0)
        fixed = away / max(float(np.linalg.norm(away, axis=1).max()), 1e-300)
        residual = np.zeros(len(pick))
    needed = [] if found.direction is None or found.stop else [np.round(found.direction, 3).tolist()]
    return {
        "readings": np.round(fixed, 3).tolist(), "residual": np.round(residual, 5).tolist(), "number": (pick + 1).tolist(), "missing": [],
        "outliers": [0] * len(pick), "needed": needed, "unit": "of the field", "field": 1,
    }  # fmt: skip


@contextlib.contextmanager
def _opened(source: str, baud: int) -> Iterator[int]:
    """Descriptor of standard input ("-") or of a serial port."""
    if source == "-":
        yield sys.stdin.fileno()
        return
    speed = getattr(termios, f"B{baud}", None)
    if speed is None:
        raise CallError(f"--baud {baud}: no speed of a serial port; 115200 is usual", "baud")
    try:
        number = os.open(source, os.O_RDONLY | os.O_NOCTTY)
    except OSError as error:
        raise CallError(f"--live {source}: {error.strerror}; name a serial port, such as /dev/ttyUSB0, or - for a pipe", "live") from error
    try:
        if os.isatty(number):
            tty.setraw(number)
            settings = termios.tcgetattr(number)
            settings[4] = settings[5] = speed
            termios.tcsetattr(number, termios.TCSANOW, settings)
        yield number
    finally:
        os.close(number)


@contextlib.contextmanager
def _served(session: _Session) -> Iterator[str]:
    """The address of the page, which is served meanwhile."""
    token, page = secrets.token_urlsafe(16), live_page()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self._answer({"": lambda: ("text/html; charset=utf-8", page), "state": self._state})

        def do_POST(self) -> None:
            self._answer({"stop": self._stop})

        def _state(self) -> tuple[str, str]:
            return "application/json", json.dumps(session.state)

        def _stop(self) -> tuple[str, str]:
            session.stopped.set()
            return "application/json", "{}"

        def _answer(self, known: dict[str, Any]) -> None:
            here = f"127.0.0.1:{server.server_port}"
            name = self.path.removeprefix(f"/{token}/")
            own = self.headers.get("Host") == here and self.headers.get("Origin", f"http://{here}") == f"http://{here}"
            if not own or name == self.path or name not in known:
                self.send_error(403)
                return
            kind, text = known[name]()
            held = text.encode()
            self.send_response(200)
            for header, value in (("Content-Type", kind), ("Content-Length", str(len(held))), ("Cache-Control", "no-store")):
                self.send_header(header, value)
            self.end_headers()
            self.wfile.write(held)

        def log_message(self, format: str, *args: Any) -> None:
            """Nothing: the terminal belongs to the answer."""

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/{token}/"
    finally:
        time.sleep(5 * _PERIOD)  # the page fetches the last state
        server.shutdown()
        server.server_close()
