"""Channels by sensor."""

from collections.abc import Iterator, Mapping
from typing import Any

_SENSORS = {"gyro": "gyroscope", "accel": "accelerometer", "mag": "magnetometer", "clock": "clock"}


def by_sensor(found: Mapping[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Sensor, its full name, and its channels with their results, for every sensor with results."""
    for sensor, name in _SENSORS.items():
        if axes := {channel: result for channel, result in found.items() if channel.startswith(f"{sensor}_")}:
            yield sensor, name, axes
