"""Every notebook runs without errors on less data, in one kernel that is cleared in between; its stored output belongs to its code."""

import importlib.util
import json
import pathlib
import re
import runpy

import nbformat
import pytest
from nbclient.exceptions import CellExecutionError

FOLDER = pathlib.Path(__file__).resolve().parents[2] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
RUN = runpy.run_path(str(FOLDER / "run.py"))


@pytest.fixture(scope="module")
def client():
    with RUN["kernel"](MPLBACKEND="Agg", JAXCAL_QUICK="1") as client:
        yield client


def test_there_are_notebooks():
    found = {path.stem for path in NOTEBOOKS}
    assert found >= {
        "quickstart", "imu_to_vio", "magnetometer", "imu_by_hand", "temperature_jump", "north_finding", "differentiable_noise", "thesis",
        "own_model", "posterior",
    }  # fmt: skip


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stored_with_its_output(path):
    notebook = nbformat.read(path, as_version=nbformat.NO_CONVERT)
    nbformat.validate(notebook)
    assert notebook.nbformat == 4
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == "error" or output.get("name") == "stderr"]
    assert notebook.metadata["jaxcal"]["sources"] == RUN["sources"](notebook), "run python notebooks/run.py again: the code has changed"
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert path.stat().st_size < 600_000
    assert not re.search(r"/(tmp|home|root|work)/", json.dumps([output for output in outputs if "image/png" not in output.get("data", {})]))


@pytest.mark.parametrize(
    "path", [pytest.param(path, id=path.stem, marks=[pytest.mark.long] * (path.stem != "quickstart")) for path in NOTEBOOKS]
)
def test_runs(path, client, tmp_path):
    if path.stem == "posterior" and importlib.util.find_spec("blackjax") is None:
        pytest.skip('needs BlackJAX: pip install "jaxcal[notebooks]"')
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.execution_count, cell.outputs = None, []
    RUN["run"](client, notebook, tmp_path)
    # the check is only valid if no cell was skipped
    assert all(cell.execution_count for cell in notebook.cells if cell.cell_type == "code")


def test_a_failing_assertion_fails_and_nothing_is_left_for_the_next(client, tmp_path):
    def notebook(code):
        return nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code)])

    with pytest.raises(CellExecutionError, match="AssertionError"):
        RUN["run"](client, notebook("left = 1\nimport jax\njax.config.update('jax_enable_x64', True)\nassert 1 + 1 == 3"), tmp_path)
    RUN["run"](client, notebook("assert 'left' not in globals()"), tmp_path)
    RUN["run"](client, notebook("import jax.numpy as jnp\nassert jnp.zeros(1).dtype == 'float32'"), tmp_path)
