"""Printed and computed tables for the degrees of freedom, by noise type (2 white phase .. -4)."""

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
