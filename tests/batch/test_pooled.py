"""Populations from the logs of a run, with devices and covariates from name patterns or tables."""

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import jaxcal
from jaxcal._answer import Number
from jaxcal.batch import Fleet, pool, run
from jaxcal.batch._fleet import Entry

SIZES = 1e-3 * np.exp(0.2 * np.random.default_rng(0).standard_normal(6))


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """A run over logs of six units at three temperatures, with one channel of 1000 samples each."""
    folder = tmp_path_factory.mktemp("fleet")
    for i, size in enumerate(SIZES):
        y = 10.0 * size * np.random.default_rng(i).standard_normal(1000)
        np.savez(folder / f"unit{i}_{20 + i % 3}C.npz", gyro=y[:, None], rate=100.0)
    with ThreadPoolExecutor(1) as executor:
        return run(folder, executor=executor, out=folder / "out", options={"terms": ("N",)})


def test_a_run_is_pooled_from_its_results(fleet):
    found = pool(fleet, names="unit{device}_{temperature}C")
    one = found["gyro_x"]
    assert one.devices == tuple("012345")
    assert one.covariates == ("temperature",)
    np.testing.assert_allclose(one.pooled[:, 0], SIZES, rtol=0.1)
    # likelihoods in the results equal those of fits
    y = np.load(fleet.done[0].path)["gyro"][:, 0]
    fit = jaxcal.noise.fit(y, 100.0, terms=("N",))
    assert one.seen[0, 0] == pytest.approx(np.log(float(fit.noise.N)), abs=1e-3)
    page, kept = (fleet.out / "overview.html").read_text(), json.loads((fleet.out / "population.json").read_text())
    assert kept["gyro_x"]["pooled"][0] == pytest.approx([float(one.pooled[0, 0])])
    for words in ("Population", "Raw and pooled values", "Odd units", "deviation of device", "effect of temperature"):
        assert words in page


def test_estimates_of_other_tasks_are_pooled(tmp_path):
    rng = np.random.default_rng(0)
    bias = 1e-5 + 2e-6 * rng.standard_normal(10)
    entries = []
    for i, value in enumerate(bias):
        known = {"hard_iron_x": Number("hard_iron_x", value, value - 2e-7, value + 2e-7, "T"), "noise": Number("noise", 1e-7)}
        entries.append(Entry(tmp_path / f"unit{i}.csv", "done", None, False, known, (), "0", None, 1.0, None, _text='{"result": {}}'))
    table = {"log": [f"unit{i}" for i in range(10)], "batch": list("ab" * 5), "place": ["hall"] * 10}
    found = pool(Fleet(tuple(entries)), table=table)["all"]
    assert (found.terms, found.covariates) == (("hard_iron_x",), ("batch b",))
    assert not found.logarithm
    assert found.spread_interval[0, 0] < 2e-6 < found.spread_interval[0, 1]
    np.testing.assert_allclose(found.pooled[:, 0], bias, atol=1e-7)
    assert [one.facts["name"] for one in found.findings if one.code == "same"] == ["place"]


def test_messages(fleet, tmp_path, refuses):
    (tmp_path / "short.csv").write_text("log,device\nunit0\n")
    alone = Fleet((Entry(tmp_path / "a", "done", None, False, {}, (), "0", None, 1.0, None, _text='{"result": {}}'),))
    for code, given, options in (
        ("pattern", fleet, {"names": "box{device}"}), ("pattern", fleet, {"names": "unit"}), ("table", fleet, {"table": {"name": [1]}}),
        ("table", fleet, {"table": {"log": ["a"]}}), ("table", fleet, {"table": tmp_path / "short.csv"}),
        ("table", fleet, {"table": tmp_path / "none.csv"}), ("nothing", Fleet(()), {}), ("nothing", alone, {}),
    ):  # fmt: skip
        with refuses(code):
            pool(given, **options)
