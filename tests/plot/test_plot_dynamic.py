"""`plot.dynamic`: contents, labels and units of the figure."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxcal import DataError
from jaxcal.allan import deviation, dynamic
from jaxcal.plot import dynamic as draw, save


@pytest.fixture(scope="module")
def result():
    y = np.random.default_rng(0).standard_normal(20_000)
    y[10_000:] *= 3.0
    y[4_000:5_500] = np.nan
    return dynamic(y, 100.0, window=20.0, step=5.0, m="octave")


def mesh(ax):
    return ax.collections[0]


def test_colours_are_the_deviation_at_its_time_and_cluster_time(result):
    ax = draw(result)
    values = mesh(ax).get_array().reshape(len(result.tau), len(result.time))
    np.testing.assert_allclose(values.filled(np.nan), result.deviation.T, rtol=1e-12)
    assert np.ma.is_masked(values)
    corners = mesh(ax).get_coordinates()
    for i, j in ((0, 0), (3, 7)):
        assert corners[i, j, 0] < result.time[j] < corners[i, j + 1, 0]
        assert corners[i, j, 1] < result.tau[i] < corners[i + 1, j, 1]
    low, high = mesh(ax).get_clim()
    assert low == pytest.approx(np.nanmin(result.deviation))
    assert high == pytest.approx(np.nanmax(result.deviation))


def test_axes_are_labelled_and_in_seconds(result):
    ax = draw(result)
    assert ax.get_xlabel() == "Time (s)"
    assert ax.get_ylabel() == "Cluster time τ (s)"
    assert (ax.get_xscale(), ax.get_yscale()) == ("linear", "log")
    assert ax.get_title(loc="left") == "Windows of 20 s"
    assert ax.get_xlim() == (7.5, 192.5)
    assert ax.figure.axes[1].get_ylabel() == "Allan deviation (unit of the record)"
    assert mesh(ax).norm.__class__.__name__ == "LogNorm"


def test_it_draws_on_given_axes_saves_and_takes_any_order(result, tmp_path):
    ax = Figure().subplots()
    assert draw(result, ax) is ax
    save(ax, tmp_path / "dynamic.png")
    assert (tmp_path / "dynamic.png").stat().st_size > 10_000
    y = np.random.default_rng(0).standard_normal(3000)
    turned = dynamic(y, 1.0, window=1000, m=[8, 1, 2])
    sorted_ = dynamic(y, 1.0, window=1000, m=[1, 2, 8])
    np.testing.assert_array_equal(mesh(draw(turned)).get_array(), mesh(draw(sorted_)).get_array())


@pytest.mark.parametrize("options", [{"window": 100, "m": [1, 2]}, {"window": 50, "m": [4]}, {"window": 100, "m": [1], "kind": "tdev"}])
def test_a_single_window_or_cluster_time(tmp_path, options):
    found = dynamic(np.random.default_rng(1).standard_normal(100), 1.0, **options)
    ax = draw(found)
    save(ax, tmp_path / "one.png")
    assert mesh(ax).get_array().size == found.deviation.size


def test_messages(result):
    y = np.random.default_rng(2).standard_normal((200, 2))
    with pytest.raises(DataError, match=r"result.channel\(0\)"):
        draw(dynamic(y, 1.0, window=50))
    with pytest.raises(DataError, match="expected a DynamicDeviation"):
        draw(deviation(y[:, 0], 1.0))
    with pytest.raises(DataError, match="the record is constant"):
        draw(dynamic(np.ones(200), 1.0, window=50))
