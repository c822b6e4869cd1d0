"""Published numbers: NIST SP 1065 (NBS14 data), Stable32 on PHASE.DAT, and curves published with an ADIS16405 recording."""

import json

import numpy as np
import pytest

import jaxcal

KINDS = ("adev", "oadev", "mdev", "tdev", "hdev", "ohdev")


def _thousand_points():
    n = [1234567890]
    for _ in range(999):
        n.append(16807 * n[-1] % 2147483647)
    return np.array(n) / 2147483647.0


def _nbs14(reference):
    """Records, whether they are rate or phase, and the published values for them."""
    table = json.loads((reference / "reference/nbs14.json").read_text())
    ten, thousand = table["ten_point"], table["thousand_point"]
    n = _thousand_points()
    assert {i: round(n[int(i)] * 2147483647) for i in thousand["check_n"]} == thousand["check_n"]
    return [
        (np.array(ten["frequency"], float), "rate", ten),
        (np.array(ten["phase"]), "phase", ten),
        (n, "rate", thousand),
        (np.concatenate([[0.0], np.cumsum(n)]), "phase", thousand),
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_nbs14(reference, kind):
    for record, data, printed in _nbs14(reference):
        found = jaxcal.allan.deviation(record, 1.0, kind=kind, m=printed["m"], data=data)
        # the published phase of the ten-point set is rounded to 8 digits
        np.testing.assert_allclose(found.deviation, printed[kind], rtol=1e-6 if data == "rate" else 1e-4)


def _stable32(path):
    rows = [line.split() for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]
    return np.array(rows, dtype=float).T


def _phase_dat(folder):
    return np.array([float(line) for line in (folder / "PHASE.DAT").read_text().splitlines() if line.strip() and not line.startswith("#")])


@pytest.mark.parametrize("table", ["octave", "all"])
@pytest.mark.parametrize("kind", KINDS)
def test_phase_dat(reference, kind, table):
    folder = reference / "data/phasedat"
    phase = _phase_dat(folder)
    m, tau, count, alpha, low, deviation, high = _stable32(folder / f"phase_dat_{kind}{'_octave' if table == 'octave' else ''}.txt")
    m = m.astype(int)
    found = jaxcal.allan.deviation(phase, 1.0, kind=kind, m=m, data="phase", confidence=0.683)
    np.testing.assert_allclose(found.tau, tau)
    np.testing.assert_allclose(found.deviation, deviation, rtol=1e-4)
    np.testing.assert_array_equal(found.count, count)
    np.testing.assert_array_equal(found.alpha, alpha)
    if table == "all":
        assert not np.any(low)  # this table has no limits
        return
    white = jaxcal.allan.deviation(phase, 1.0, kind=kind, m=m, data="phase", confidence=0.683, alpha=0)
    there = alpha == 0
    assert there.sum() >= 7
    np.testing.assert_allclose(white.lower[there], low[there], rtol=1e-3)
    np.testing.assert_allclose(white.upper[there], high[there], rtol=1e-3)


@pytest.fixture(scope="module")
def adis(reference):
    stored = np.load(reference / "data/adis16405/imu1.npz")
    return stored["counts"] * stored["scale"], json.loads((reference / "reference/adis16405_curves.json").read_text())


def test_adis16405_published_curves(adis):
    record, curves = adis
    names = list(curves["adis_av"]["avar"])
    levels = np.array(curves["adis_av"]["avar"][names[0]]["levels"])
    m = np.round(levels * 100.0).astype(int)
    assert len(names) == 6
    assert len(m) == 18
    found = jaxcal.allan.deviation(record, 100.0, m=m)
    theta = np.concatenate([np.zeros((1, 6)), np.cumsum(record - record.mean(axis=0), axis=0)])
    for i, name in enumerate(names):
        published = np.array(curves["adis_av"]["avar"][name]["allan"])
        np.testing.assert_allclose(found.deviation[:, i] ** 2, published, rtol=1e-5)
        # the publisher omits the last difference but divides by the full number of differences
        last = theta[-1, i] - 2.0 * theta[-1 - m, i] + theta[-1 - 2 * m, i]
        count = found.count[:, i]
        np.testing.assert_allclose(found.deviation[:, i] ** 2 - last**2 / (2.0 * m**2 * count), published, rtol=1e-9)


@pytest.mark.parametrize("kind", ["mtie", "tierms"])
def test_phase_dat_errors_of_time(reference, kind):
    m, _, count, expected = _stable32(reference / f"data/phasedat/phase_dat_{kind}.txt")
    phase, drift = _phase_dat(reference / "data/phasedat"), 3.0 * np.arange(1001)
    for data, x in (("phase", phase), ("rate", np.diff(phase))):
        found = jaxcal.allan.deviation(x, 1.0, kind=kind, m=m.astype(int), data=data)
        np.testing.assert_allclose(found.deviation, expected, rtol=1e-4)
        np.testing.assert_array_equal(found.count, count)
    assert np.isnan(found.upper).all()
    # a frequency offset is kept: the error of time grows with it
    found = jaxcal.allan.deviation(1e3 * drift + phase, 1.0, kind=kind, m=[1000], data="phase")
    np.testing.assert_allclose(found.deviation, 3e6, rtol=1e-3)
