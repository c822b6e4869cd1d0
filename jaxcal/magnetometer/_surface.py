"""The surface through the readings: its kind, its fit, and what the readings cannot show of it."""

from typing import Any, NamedTuple

import numpy as np

from .._answer import NOTE, Finding
from ._design._heading_error import heading_error
from ._ellipsoid._algebraic import consistent, constrained, extents
from ._ellipsoid._kinds import COUNT, PLANAR, SOLID, parameters_of
from ._ellipsoid._orthogonal import described, flat, left_out, refined
from ._ellipsoid._select import by_bic, candidates
from ._ellipsoid._shape import NEAR_PLANAR, Found, Frame, covariance_of, in_plane, model_of, radius_of
from ._findings import FINDINGS
from ._iron import by_surface

_LINE = 0.01  # singular value of the centred readings over their size, 0.58 for a full sphere, below which they lie on a line
_FEW = 64  # rows among which distinct ones are counted first: more than any model needs
_SAME = 1e-12  # spread over size below which readings differ by rounding
#: method -> algebraic fit
_DIRECT = {"constrained": constrained, "consistent": lambda u: consistent(u)[:2]}


class Surface(NamedTuple):
    """A fitted surface, or the finding why there is none.

    u : scaled readings, in the axes of their plane if there is one. unseen : (k, 9) biases due to terms that a smaller model leaves out.
    said : findings.
    """

    refused: Finding | None
    found: Any = None
    frame: Any = None
    plane: Any = None
    u: Any = None
    unseen: Any = None
    said: tuple[Finding, ...] = ()

    def scaled(self, m: np.ndarray) -> np.ndarray:
        """Other readings in the same axes."""
        u = self.frame.scaled(m)
        return u if self.plane is None else in_plane(u, self.plane)


def surface_of(m, method, model, penalty, limit: tuple[float, float]) -> Surface:
    """The surface through readings (n, 3); `limit`: a dip, and the heading error that a good fit may have there.

    Raises
    ------
    NotEllipsoid
        If the readings lie on another quadric.
    """
    count, frame = distinct(m), Frame.of(m)
    if count < 2 or frame.scale < _SAME * np.abs(m).max():
        return Surface(FINDINGS("few", count=count, model="sphere", least=COUNT["sphere"] + 1))
    u = frame.scaled(m)
    spread = extents(u)
    if spread[1] < _LINE:
        return Surface(FINDINGS("line"))
    chosen_planar = spread[2] < NEAR_PLANAR and model == "auto" and method == "ml"
    planar = model == "planar" or chosen_planar
    kind = None if model == "auto" or planar else model
    if kind is None and method != "ml":
        kind = "symmetric"
    least = kind or ("circle" if planar else "sphere")
    if count <= COUNT[least]:
        return Surface(FINDINGS("few", count=count, model="planar" if planar else least, least=COUNT[least] + 1))
    plane, unseen, said = None, np.zeros((0, 9)), ()
    if planar:
        plane = np.linalg.svd(u, full_matrices=False)[2]
        plane[2] *= np.sign(np.linalg.det(plane))
        u = in_plane(u, plane)
        said = (FINDINGS("plane") if chosen_planar else FINDINGS("plane", severity=NOTE),)
    if kind is None:
        fits, occupied = candidates(u, PLANAR if planar else SOLID, count)
        chosen = fits[by_bic(fits, occupied)]
        said += _unseen(fits, chosen, frame, plane, *limit)
        unseen = left_out(fits, chosen, u, penalty)[None]
        found = refined(chosen, u, penalty)
    elif method == "ml":
        found = refined(flat(u, kind), u, penalty)
    else:
        found = described(parameters_of(kind, *_DIRECT[method](u)), u, kind)
    return Surface(None, found, frame, plane, u, unseen, said)


def distinct(m: np.ndarray) -> int:
    """Number of distinct readings; only the first few are counted where these suffice for any model."""
    few = len({row.tobytes() for row in m[:_FEW] + 0.0})  # adding zero turns -0.0 into 0.0
    return few if few > COUNT["symmetric"] else len(np.unique(m, axis=0))


def _unseen(fits: dict[str, Found], chosen: Found, frame: Frame, plane: Any, dip: float, limit: float) -> tuple[Finding, ...]:
    """A finding if a smaller model was fitted because the readings cannot show the largest one."""
    largest = "ellipse" if chosen.kind in PLANAR else "symmetric"
    full = fits.get(largest)
    if chosen.kind == largest:
        return ()
    if full is not None and full.converged and _error(full, frame, dip, plane) <= limit:
        return ()
    what = "an ellipse" if chosen.kind in PLANAR else "a full soft iron matrix"
    return (FINDINGS("small_model", what=what, model=chosen.kind),)


def _error(found: Found, frame: Frame, dip: float, plane: Any) -> float:
    """Heading error in rad at level of a fit whose readings are white."""
    iron = model_of(found.shape, found.centre, frame, radius_of(found.shape, plane is not None), plane)
    size = radius_of(found.shape, plane is not None) * frame.scale
    known = by_surface(iron.soft_iron, size, covariance_of(found, frame), False, plane)
    return float(heading_error(iron, size, known[:12, :12], dip, plane=plane)[0])
