"""`Noise`: the noise family of IEEE Std 952 as one composable model."""

import equinox as eqx

from .._types import Any


class Noise(eqx.Module):
    """Coefficients of independent noise terms of a rate or specific-force channel, SI, two-sided densities.

    Fields are floats, or arrays over channels: Q (rad; m/s), N (rad/sqrt(s)), B (rad/s), K (rad/s/sqrt(s)), R (rad/s^2),
    markov ((qc, Tc), ...), sinusoid ((A, f0), ...).
    """

    Q: Any = 0.0
    N: Any = 0.0
    B: Any = 0.0
    K: Any = 0.0
    R: Any = 0.0
    markov: tuple[tuple[Any, Any], ...] = ()
    sinusoid: tuple[tuple[Any, Any], ...] = ()
