"""What the model of a fit lacks: drifts of the gyro, a tilting base and errors of the table's angles, simulated without jaxcal."""

import itertools
import re

import numpy as np
import pytest

import jaxcal
from jaxcal.alignment import Positions, Readings, fit, from_log
from jaxcal.alignment._lack import there_and_back
from jaxcal.noise import Noise

from . import world
from .cases import DEG

NOISE = {name: Noise(N=c[0]) for name, c in (("accel", world.ACCEL), ("gyro", world.GYRO))}
NAMES = ("phi", "theta", "psi")


def results(plan, runs, known=True, parts=True, kind="none", **faults):
    """Results of `runs` raw logs, and which of their intervals hold the truth, as a withheld number does; `encoder` leaves angles open."""
    made = []
    for run in range(runs):
        rng = np.random.default_rng([run, 31])
        attitude = np.array([1.0, 2.0, rng.uniform(-180, 180)]) * DEG
        options = {"rate": 10.0, "drift": world.DRIFTS[kind], **faults}
        time, angle, accel, gyro, _, _ = world.recording(rng, plan[0], [plan[1]] * len(plan[0]), "white", attitude, **options)
        got = from_log(jaxcal.Log(time, accel=accel, gyro=gyro), angle=angle, noise=NOISE if known else None,
                       angle_std=None if "encoder" in faults else 0.0)  # fmt: skip
        found = got.fit(world.LATITUDE) if parts else fit(Readings(got.readings.positions, got.readings.accel, got.readings.gyro,
            accel_noise=NOISE["accel"], gyro_noise=NOISE["gyro"]), world.LATITUDE)  # fmt: skip
        numbers = [found.estimate[name] for name in NAMES]
        off = [abs((one.value - truth + np.pi) % (2 * np.pi) - np.pi) for one, truth in zip(numbers, attitude, strict=True)]
        made.append((found, [one.state == "open" or error <= one.half for one, error in zip(numbers, off, strict=True)], off))
    found, held, off = zip(*made, strict=True)
    return found, np.mean(held, axis=0), np.sqrt(np.mean(np.square(off), axis=0))


FOUR, MIRRORED = world.PLANS["4 x 120 s"], world.PLANS["8 mirrored x 60 s"]


@pytest.mark.parametrize(
    ("plan", "kind", "parts"),
    [
        (FOUR, "linear", True), (FOUR, "linear", False), (MIRRORED, "quadratic", True),
        *(pytest.param(*one, marks=pytest.mark.long) for one in (
            (FOUR, "exponential", True), (MIRRORED, "exponential", False), (world.PAIRS, "exponential", True), (world.PAIRS, "step", True),
        )),
    ],
)  # fmt: skip
def test_a_drift_is_named_and_the_azimuth_holds_or_is_withheld(plan, kind, parts):
    runs = 15
    found, held, off = results(plan, runs, kind=kind, parts=parts)
    assert np.mean(["drift" in one.codes and one.verdict != "good" for one in found]) > 0.9
    assert held[2] > 0.95 - 3 * np.sqrt(0.95 * 0.05 / runs)
    assert plan is not world.PAIRS or off[2] < 1.3 * results(plan, runs)[2][2]  # with the same noise


@pytest.mark.parametrize("plan", [FOUR, *(pytest.param(plan, marks=pytest.mark.long) for plan in (MIRRORED, world.PAIRS))])
def test_without_a_drift_nothing_is_found_and_the_estimate_is_as_good_as_before(plan):
    runs = 60
    found, held, off = results(plan, runs)
    # three in a hundred are said to misfit
    assert np.mean([one.verdict == "good" for one in found]) > 0.97 - 3 * np.sqrt(0.03 * 0.97 / runs)
    assert not any({"drift", "tilt"} & one.codes for one in found)
    assert np.all(held > 0.83)
    # the bound without a drift: N sqrt(2 / T) over the horizontal part of the Earth's rate; T is what the ends of the rests leave of 480 s
    seconds = np.mean([one.readings.positions.dwell.sum() for one in found])
    bound = world.GYRO[0] * np.sqrt(2 / seconds) / (world.EARTH * np.cos(world.LATITUDE))
    assert off[2] < bound * (1.01 + 3 / np.sqrt(2 * runs))
    assert np.median([one.azimuth_std for one in found]) / bound < 1.01
    assert all(("drift_order" in one.codes) == (plan is not world.PAIRS) for one in found)


def test_a_step_that_four_positions_cannot_show_is_named_with_its_size_and_the_order_that_shows_it():
    runs = 10
    found, held, _ = results(FOUR, runs, kind="step", encoder=0.0)
    assert held[2] < 1  # without a residual that would show it
    # what the terminal prints, whatever else there is to say
    said = [" ".join(str(one).split()) for one in found if one.verdict == "good"]
    assert said
    assert all(re.search(r"azimuth changes by up to [\d.]+ deg for each deg/h .* order 0, 180, 180, 0, 90, 270, 270, 90", x) for x in said)
    order = [one for result in found for one in result.findings if one.code == "drift_order"]
    assert len(order) == runs
    # a step of 1 deg/h in the middle changes both harmonics by 0.5 deg/h, of 12.3
    assert max(one.facts["size"].value for one in order) == pytest.approx(np.sqrt(0.5) / (15.041 * np.cos(world.LATITUDE)), rel=0.05)


def test_a_tilting_base_is_named():
    found, held, _ = results(FOUR, 20, tilt=41 / 3600 * DEG)
    assert np.mean(["tilt" in one.codes or "misfit" in one.codes for one in found]) >= 0.9
    assert np.all(held[:2] >= 0.8)


@pytest.mark.parametrize(
    ("plan", "known", "runs"),
    [(FOUR, True, 10), *(pytest.param(*one, 20, marks=pytest.mark.long) for one in ((FOUR, False), (world.PAIRS, False)))],
)
def test_errors_of_the_angles_are_no_tilt(plan, known, runs):
    found, held, _ = results(plan, runs, known, encoder=0.1 * DEG, repeats=plan is not FOUR)  # residuals do not show a repeated error
    assert np.mean(["tilt" in one.codes for one in found]) <= 0.1
    assert np.all(held > 0.95 - 3 * np.sqrt(0.95 * 0.05 / runs))


@pytest.mark.parametrize(("plan", "runs"), [(FOUR, 10), *(pytest.param(plan, 30, marks=pytest.mark.long) for plan in (FOUR, world.PAIRS))])
def test_the_intervals_allow_for_errors_of_the_angles_that_the_residuals_do_not_exclude(plan, runs):
    plain, level = [], []
    for encoder in (0.0, 0.05, 0.1):
        found, held, off = results(plan, runs, encoder=encoder * DEG, repeats=True)
        assert np.all(held > 0.95 - 3 * np.sqrt(0.95 * 0.05 / runs))
        plain.append(np.median([one.azimuth_std for one in found if one.psi is not None]))
        good = [one for one in found if one.verdict == "good"]
        assert all("angles_open" in one.codes for one in good)
        # also where the one residual of the accelerometer is small by chance, the errors are of the size that they have
        level.append(min(one.std["phi"] for one in good) / off[0])
    exact = np.median([one.azimuth_std for one in results(plan, runs)[0]])
    # an error of each of four angles moves the azimuth by (sin^4 + cos^4) / 2 of its variance, 3/8 in the mean: less than with 0.1 degrees
    assert exact * (1 - 1e-6) < plain[0] < np.hypot(exact, np.sqrt(3 / 8) * 0.1 * DEG)
    assert plain[0] < plain[1] < plain[2]
    assert min(level) > 1 / 3


def test_the_order_is_the_best_of_all():
    """Of all orders of twice four angles it leaves least of a linear and a quadratic drift, and of a step at any time."""

    def left(order):
        n = np.shape(order)[-1]
        u, z = (np.arange(n) - (n - 1) / 2) / n, np.exp(1j * np.deg2rad(order)) / (n / 2)
        shapes = np.array([u, u**2, *(np.arange(n) >= k for k in range(1, n))], dtype=float)
        return np.abs(np.asarray(z) @ shapes.T)

    orders = np.array(sorted(set(itertools.permutations([0, 0, 90, 90, 180, 180, 270, 270]))))
    every = left(orders)
    smooth, worst = every[:, :2].max(axis=1), every.max(axis=1)
    order = np.rad2deg(there_and_back(np.deg2rad([0, 90, 180, 270]))).round()
    own, twice = left(order), left(np.concatenate([order, order[::-1]]))
    assert own[:2].max() == pytest.approx(smooth.min(), abs=1e-9)
    assert own.max() == pytest.approx(worst.min(), abs=1e-9)
    # back again it leaves a quarter of a quadratic drift and half of a step
    assert twice[:2] == pytest.approx(own[:2] / 4, abs=1e-9)
    assert twice.max() == pytest.approx(own.max() / 2, abs=1e-9)


@pytest.mark.parametrize("drift", [0.0, 2e-6])
def test_the_errors_are_proportional_to_all_noise_and_allow_for_little_in_plain_readings(drift):
    places, rng = Positions(np.deg2rad([0, 180, 180, 0, 90, 270, 270, 90]), dwell=120.0, angle_std=0.0), np.random.default_rng(0)
    clean = [vector[:, 0] for vector in world.vectors(np.array([1.0, 2.0, 40.0]) * DEG, np.asarray(places.angle))]
    off = [c[0] * (rng.normal(size=8) / np.sqrt(120) + drift * np.arange(8) * 1e4) for c in (world.ACCEL, world.GYRO)]
    std = []
    for times in (1, 2):
        noise = {f"{name}_noise": times * one.N for name, one in NOISE.items()}
        readings = Readings(places, *(x + times * e for x, e in zip(clean, off, strict=True)), **noise)
        std.append([fit(readings, world.LATITUDE, **more).azimuth_std for more in ({}, {"start": {"b_g_rate": 0.0}})])
    assert std[1] == pytest.approx([2 * one for one in std[0]], rel=1e-3)
    assert drift or std[0][0] < 1.03 * std[0][1]
