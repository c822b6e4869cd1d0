"""One device: accelerometer, gyroscope and magnetometer calibrated together, from one recording by hand.

A recording determines far more than its sensors do one by one. Gravity and the field of the Earth are constants of the world: the
gyroscope says how both turn in the frame of the device, and a hand stays in its place. `fit` writes all of this into one likelihood.
"""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._fit import fit as fit
    from ._hand import HandMotion as HandMotion
    from ._model import DeviceModel as DeviceModel
    from ._result import DeviceFit as DeviceFit
    from ._simulate import random_device as random_device, simulate as simulate

install(
    __name__,
    {
        "_fit": "fit",
        "_hand": "HandMotion",
        "_model": "DeviceModel",
        "_result": "DeviceFit",
        "_simulate": "random_device simulate",
    },
)
