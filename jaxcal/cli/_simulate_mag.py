"""`jaxcal simulate mag`: a log of a magnetometer in many attitudes."""

from pathlib import Path
from typing import Literal

from .._units import STANDARD_GRAVITY
from ._options import CallError, Running
from ._outputs import staged
from ._screen import Screen, progress, show_written
from ._simulate import SUFFIXES, save_log


def simulate_mag(
    *,
    out: Path,
    scenario: Literal["all", "three_turns", "twelve_points"] = "all",
    samples: int | None = None,
    noise: float = 0.2,
    field: float = 47.0,
    inclination: float = 57.0,
    hard_iron: tuple[float, float, float] = (21.7, 5.2, -10.2),
    soft_iron: float = 0.1,
    mounting: float = 0.0,
    running: Running = Running(),
) -> None:
    """A log of a magnetometer in many attitudes, with the specific force at rest.

    Hard iron, soft iron and mounting are printed: the truth to hold
    jaxcal mag against.

    Parameters
    ----------
    out
        File to write: FILE.csv or FILE.npz, in SI units.
    scenario
        Attitudes: all, three_turns, or twelve_points, as in the magnetometer paper.
    samples
        Attitudes of all (360), or headings of each turn.
    noise
        Standard deviation of an axis of a reading in uT; the specific force has the same part of gravity.
    field
        Norm of Earth's field in uT.
    inclination
        Its dip in degrees.
    hard_iron
        Offset in uT.
    soft_iron
        Largest entry of the symmetric matrix that is added to the unit matrix, drawn with the seed.
    mounting
        Angle in degrees by which the magnetometer is turned about its z axis.
    """
    if not noise >= 0 or not field > 0 or not abs(inclination) < 90 or not 0 <= soft_iron < 0.3:
        raise CallError("expected --noise of 0 or more, a positive --field, --inclination within 90 degrees, --soft-iron from 0 to 0.3")
    if out.suffix not in SUFFIXES:
        raise CallError(f"--out {out}: expected a name that ends in {' or '.join(SUFFIXES)}")
    if samples is not None and samples < 1:
        raise CallError(f"--samples {samples}: expected at least one")
    screen = Screen(running.quiet)
    with staged([out]) as places, progress("simulating", running.quiet):
        import numpy as np

        from ..magnetometer import MagModel, body_field, scenario as attitudes_of

        random = np.random.default_rng(running.seed)
        half = random.uniform(-soft_iron, soft_iron, (3, 3))
        angle = np.deg2rad(mounting)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
        true = MagModel((np.eye(3) + (half + half.T) / 2) @ turn, 1e-6 * np.array(hard_iron))
        attitudes = attitudes_of(scenario, samples=samples, seed=running.seed)
        h = np.asarray(body_field(attitudes, 1e-6 * field, np.deg2rad(inclination)))
        up = -STANDARD_GRAVITY * np.asarray(body_field(attitudes, 1.0, np.pi / 2))
        m = np.asarray(true.measure(h)) + 1e-6 * noise * random.standard_normal(h.shape)
        up = up + STANDARD_GRAVITY * noise / field * random.standard_normal(h.shape)
        save_log(places[out], np.arange(len(m)) / 10.0, {"accel": up, "mag": m})
    screen.line(f"{len(m)} attitudes; hard iron {', '.join(f'{b:g}' for b in hard_iron)} uT; soft iron")
    for row in np.asarray(true.soft_iron):
        screen.line("  " + "  ".join(f"{c:+.5f}" for c in row))
    show_written(screen, [out])
