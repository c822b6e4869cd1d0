"""One device: accelerometer, gyroscope and magnetometer calibrated together, from one recording by hand.

Fitted together, the sensors determine more than each of them alone. Gravity and the Earth's field are constant in the world, the gyroscope
shows how both rotate in the frame of the device, and a hand stays within reach. `fit` uses all of this in one likelihood.
"""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._fit import fit as fit
    from ._hand import HandMotion as HandMotion
    from ._model import DeviceModel as DeviceModel
    from ._result import DeviceFit as DeviceFit
    from ._simulate import random_device as random_device, simulate as simulate

install(__name__, {
    "_fit": "fit", "_hand": "HandMotion", "_model": "DeviceModel", "_result": "DeviceFit", "_simulate": "random_device simulate",
})  # fmt: skip
