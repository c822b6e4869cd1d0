"""Figures by matplotlib's object interface; they open no window and change no global setting."""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._allan import allan as allan
    from ._imu import imu as imu
    from ._magnetometer import coverage as coverage, heading_error as heading_error, sphere as sphere
    from ._north import north as north
    from ._spectrum import spectrum as spectrum
    from ._style import TERM_COLORS as TERM_COLORS, save as save
    from ._temperature import temperature as temperature

install(
    __name__,
    {
        "_allan": "allan",
        "_imu": "imu",
        "_magnetometer": "coverage heading_error sphere",
        "_north": "north",
        "_spectrum": "spectrum",
        "_style": "TERM_COLORS save",
        "_temperature": "temperature",
    },
)
