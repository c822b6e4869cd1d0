"""Printed and computed tables for the degrees of freedom and the bias, by noise type (2 white phase .. -4)."""

import numpy as np

#: C. A. Greenhall and W. J. Riley, PTTI 2003 (NIST SP 1065, section 5.3): the generalised autocovariance of phase as sign, power of |t|
#: and whether times ln |t|; then, by the order of the difference, table 1 (modified statistics), table 2 and table 3
GREENHALL_RILEY = {
    "walk": {2: (-1, 1, 0), 1: (1, 2, 1), 0: (1, 3, 0), -1: (-1, 4, 1), -2: (-1, 5, 0), -3: (1, 6, 1), -4: (1, 7, 0)},
    "modified": {
        2: {2: (7 / 9, 1 / 2), 1: (0.997, 0.616), 0: (1.033, 0.607), -1: (1.048, 0.534), -2: (1.302, 0.535)},
        3: {2: (22 / 25, 2 / 3), 1: (1.141, 0.843), 0: (1.184, 0.848), -1: (1.180, 0.816), -2: (1.175, 0.777),
            -3: (1.194, 0.703), -4: (1.489, 0.702)},
    },
    "plain": {
        2: {2: (35 / 18, 1.0), 1: (790.0, 410.0), 0: (2 / 3, 1 / 3), -1: (0.852, 0.375), -2: (1.079, 0.368)},
        3: {2: (231 / 100, 3 / 2), 1: (9950.0, 6520.0), 0: (7 / 9, 1 / 2), -1: (0.997, 0.617), -2: (1.033, 0.607),
            -3: (1.053, 0.553), -4: (1.302, 0.535)},
    },
    "flicker": {2: (15.23, 12.0), 3: (47.8, 40.0)},
}  # fmt: skip
#: total statistics. Degrees of freedom at ratios of record and cluster time, of mtotdev for white phase .. random walk of rate, and of
#: htotdev, which treats rate as mtotdev treats phase, for white rate .. -4; factors for small cluster sizes, which average fewer points
#: than large ones; and for totdev the bias 1 + a tau / T
WINDOWS = {
    "ratios": np.array([3.0, 4.0, 6.0, 8.0, 12.0, 24.0, 48.0]),
    "edf": np.array([
        [3.457, 5.083, 7.623, 11.02, 18.22, 40.11, 83.65],
        [2.448, 3.179, 4.961, 7.257, 12.08, 26.77, 56.43],
        [2.044, 2.591, 4.342, 6.416, 10.74, 23.86, 50.29],
        [1.676, 2.109, 3.946, 5.922, 9.980, 22.27, 46.92],
        [1.313, 1.557, 2.928, 4.512, 7.730, 17.44, 36.90],
    ]),
    "sizes": np.array([1.0, 2.0, 4.0, 8.0, 16.0]),
    "factors": np.array([
        [0.284, 0.677, 0.897, 0.969, 1.0],
        [0.504, 0.961, 1.013, 1.007, 1.0],
        [0.607, 1.099, 1.036, 1.006, 1.0],
        [0.858, 1.070, 1.005, 1.000, 1.0],
        [1.098, 1.048, 0.999, 0.995, 1.0],
    ]),
    "totdev": {2: 4.0 / 3.0, 1: 4.0 / 3.0, 0: 0.0, -1: -0.481, -2: -0.750},
}  # fmt: skip
