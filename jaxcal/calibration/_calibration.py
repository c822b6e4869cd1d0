"""`Calibration`: all data about one device in one object and one file."""

import os
import pathlib
from typing import Any

import equinox as eqx

from .._answer import tables
from .._answer._html import answer_html
from .._errors import DataError
from .._files import json_text, version_of, write_atomically
from .._log import Log
from .._precision import is_traced
from .._types import Given
from ..magnetometer import MagModel
from ._codec import SCHEMA, free, read_document, to_json, wrong
from ._compose import composed
from ._correct import corrected
from ._noise import DeviceNoise, device_noise
from ._parts import Imu, Part, imu_of, magnetometer_of
from ._show import sections_of
from ._thermal import Thermal, thermal_of

_SECTIONS = ("noise", "imu", "magnetometer", "temperature")


class Calibration(eqx.Module):
    """Everything known about one device: noise, deterministic models, thermal model, and the origin of the numbers.

    Parameters
    ----------
    noise : the result of `jaxcal.noise.characterise` (channel -> `NoiseFit`), or the stored form: {"rate": Hz, "gyro": {"unit":
        "rad/s", "Q": (3,), "N": (3,), "B": (3,), "K": (3,), "R": (3,)}, "accel": {...}, "mag": {...}}, with None for unknown
        coefficients. Stored as `DeviceNoise`.
    imu : an `ImuFit`, a `DeviceFit`, {"accel": `Triad`, "gyro": `Triad`}, or the stored form: {"accel": {"unit": "m/s^2", "matrix":
        (3, 3), "bias": (3,), "covariance"}, "gyro": {"unit": "rad/s", "matrix", "bias", "g_sensitivity": (3, 3), "covariance"}}, where
        y = matrix x + bias + g_sensitivity a. Stored as `Imu`: `imu.gyro.model` is the `Triad`, `imu.gyro.estimate` its uncertainty.
    magnetometer : a `MagFit` of readings in tesla, a `DeviceFit`, a `MagModel`, or the stored form: {"unit": "T", "soft_iron": (3, 3),
        "hard_iron": (3,), "field", "covariance"}, where measured = soft_iron true + hard_iron. Stored as `Part`: `magnetometer.model` is
        the `MagModel`.
    temperature : the result of `jaxcal.temperature.characterise` (channel -> `TemperatureFit`), or the stored form: {"unit": "degC",
        "reference", "minimum", "maximum"} with one of two entries. "accel" and "gyro" (3, powers) are coefficients of the powers 1, 2, ...
        of the temperature above the reference, in the unit of the sensor. "channels": {"gyro_x": {"curve", "minimum", "maximum", "lag",
        "play", ...}, ...} stores any thermal model exactly. Stored as `Thermal`, channel -> `ThermalModel`.
    device : name, or a dictionary with "name" and the ids by which flight controllers identify a sensor.
    provenance : dictionary with the origin of the numbers: the recording ("file", "sha256") and the options used ("options"). The
        version of jaxcal is added as "version".

    A covariance is None or {"parameters": names in their order, "values": (p, p)}. If you define a subclass of `Triad`, `MagModel` or a
    thermal curve, it is stored with the name of its class. To load it, import the module that defines the class first.

    Raises
    ------
    DataError
        If a section lacks a key, or contains anything but numbers of the right shape; the message names the key.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxcal
    >>> gyro = {"unit": "rad/s", "Q": None, "N": [1e-4] * 3, "B": None, "K": [2e-6] * 3, "R": None}
    >>> calibration = jaxcal.Calibration(noise={"rate": 200.0, "gyro": gyro}, device="unit 7")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "device.json")
    ...     calibration.save(path)
    ...     jaxcal.Calibration.load(path).noise.gyro.N
    array([0.0001, 0.0001, 0.0001])
    """

    noise: DeviceNoise | None
    imu: Imu | None
    magnetometer: Part[MagModel] | None
    temperature: Thermal | None
    device: dict[str, Any] | None
    provenance: dict[str, Any] | None

    def __init__(
        self, *, noise: Given | None = None, imu: Given | None = None, magnetometer: Given | None = None, temperature: Given | None = None,
        device: str | Given | None = None, provenance: Given | None = None,
    ) -> None:  # fmt: skip
        self.noise, self.imu = device_noise(noise), imu_of(imu)
        self.magnetometer, self.temperature = magnetometer_of(magnetometer), thermal_of(temperature)
        self.device = _free({"name": device} if isinstance(device, str) else device, "device")
        provenance = _free(provenance, "provenance")
        if provenance is not None and "version" not in provenance:
            provenance["version"] = version_of("jaxcal")
        self.provenance = provenance

    def _title(self) -> str:
        name = (self.device or {}).get("name")
        return "Calibration" + (f" of {name}" if name else "")

    def __repr__(self) -> str:
        """Every number with half of its 95 % interval and its unit."""
        return eqx.tree_pformat(self) if is_traced(self) else "\n".join(tables("", self._title(), sections_of(self), (), width=100))

    def _repr_html_(self) -> str:
        """The same as tables, for notebooks."""
        return answer_html(self._title(), "", sections_of(self), ())

    def correct(self, log: Log, *, currents: dict[str, Any] | None = None) -> Log:
        """Correct a log with this calibration, by equations (5.4) and (5.5) of the thesis.

        The thermal models come first, at the temperature of the log (a slow thermometer is interpolated). Then come bias, g-sensitivity,
        scale factor and misalignment, and the magnetometer's iron. Without an `imu` section, a gyroscope is corrected to zero at rest. For
        other sensors, only the change since the reference temperature is subtracted, because the rest is gravity or field.

        Parameters
        ----------
        log : recording of the same device; missing samples stay missing.
        currents : name -> (n,) current at each sample, for the terms that `magnetometer.fit` found. A sample without a current
            becomes missing.

        Returns
        -------
        Log, on the same grid. Its `warnings` report temperatures outside the models, temperatures that pass a jump, and a model that was
        fitted to this same recording; its `notes` list the corrections.

        Raises
        ------
        DataError
            If nothing in the log can be corrected, a thermal model finds no temperature in it, or a current is unknown.

        Examples
        --------
        >>> import jaxcal
        >>> made = jaxcal.temperature.simulate(seed=1)
        >>> log = jaxcal.Log(made.time, gyro=made.bias, temperature=made.temperature)
        >>> device = jaxcal.Calibration(temperature=jaxcal.temperature.characterise(log))
        >>> bool(device.correct(log).gyro.std() < log.gyro.std() / 20)
        True
        """
        return corrected(self, log, currents)

    def compose(self, other: "Calibration") -> "Calibration":
        r"""One calibration of raw readings that combines `other`, applied first, and this one.

        Use it for a calibration fitted to readings that the device had already corrected with `other`:

        .. math:: C = C_\mathrm{self} C_\mathrm{other}, \quad b = b_\mathrm{other} + C_\mathrm{other}^{-1} b_\mathrm{self}

        The numbers of `other` count as exact, because they were the ones applied. The covariance is that of this calibration, transformed
        to the raw readings.

        Parameters
        ----------
        other : the calibration that was applied to the readings first.

        Returns
        -------
        Calibration, with the device of this calibration, or else of `other`.

        Raises
        ------
        DataError
            If this calibration has thermal models, and `other` thermal models or an imu section; or one has a model of your own.

        Examples
        --------
        >>> import numpy as np
        >>> import jaxcal
        >>> def scaled(s, b):
        ...     return jaxcal.Calibration(imu={"accel": jaxcal.imu.Triad(s * np.eye(3), b * np.ones(3))})
        >>> both = scaled(1.01, 0.1).compose(scaled(2.0, 0.5))
        >>> both.imu.accel.model.matrix[0, 0], both.imu.accel.model.bias
        (np.float64(2.02), array([0.7, 0.7, 0.7]))
        """
        steps = {"first": other.provenance, "then": self.provenance}
        return Calibration(**composed(self, other), device=self.device or other.device, provenance={"composed": steps})

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the calibration as JSON, schema "jaxcal.calibration/1".

        Every number is exact. JSON has no NaN and no infinity: both become null, which is read as NaN.

        Parameters
        ----------
        path : file to write; an existing one is replaced in one step.

        Raises
        ------
        ExportError
            If the file cannot be written.
        """
        document = {"schema": SCHEMA, "device": self.device, "provenance": self.provenance}
        held = {name: to_json(getattr(self, name)) for name in _SECTIONS if getattr(self, name) is not None}
        write_atomically(path, json_text(document | held))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Calibration":
        """Read a file written by `save`.

        Parameters
        ----------
        path : JSON file, schema "jaxcal.calibration/1". Keys that this version does not know are ignored.

        Raises
        ------
        DataError
            If the file is not such a calibration; the message names the wrong key.
        """
        try:
            document = read_document(pathlib.Path(path))
            provenance = document.get("provenance")
            if isinstance(provenance, dict):
                provenance.setdefault("version", None)  # keep it unknown: the file was not written by this version
            sections = {name: document.get(name) for name in _SECTIONS}
            return cls(**sections, device=document.get("device"), provenance=provenance)
        except DataError as error:
            raise error.of(os.fspath(path)) from error.__cause__
        except RecursionError:
            raise DataError(f"{path} has lists within lists without end; expected a file of Calibration.save", code="endless") from None


def _free(value: Any, name: str) -> dict[str, Any] | None:
    """A dictionary given by the user, or None."""
    if value is not None and not isinstance(value, dict):
        raise wrong(value, "a dictionary", name)
    return free(value, name)
