"""Names that `import jaxcal` provides, and settings that it must not change."""

import ast
import importlib.metadata
import inspect
import os
import pathlib
import re
import subprocess
import sys
import textwrap
import tomllib

import pytest

import jaxcal

ROOT = pathlib.Path(__file__).resolve().parents[1]
HEAVY = ("jax", "equinox", "optimistix", "scipy", "matplotlib", "polars", "rosbags", "cyclopts", "rich")


def run(code):
    """Output of `code` in a new interpreter."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def test_import_loads_nothing_heavy():
    assert run(f"import sys, jaxcal; print([name for name in {HEAVY} if name in sys.modules])") == "[]"


def test_every_part_leaves_the_jax_configuration_alone():
    code = (
        "import jax; before = dict(jax.config.values)\n"
        "import sys, jaxcal; [getattr(jaxcal, name) for name in dir(jaxcal)]\n"
        "print({k: v for k, v in jax.config.values.items() if before.get(k) != v})\n"
        "print([name for name in ('matplotlib', 'polars', 'rosbags', 'cyclopts', 'rich') if name in sys.modules])"
    )
    assert run(code).splitlines() == ["{}", "[]"]


PUBLIC = {
    "Calibration", "DataError", "ExportError", "FitError", "JaxcalError", "Log", "PrecisionWarning", "UnitError",
    "alignment", "allan", "batch", "budget", "calibration", "device", "evidence", "export", "fitting", "imu", "io", "magnetometer", "noise",
    "plot", "read", "report", "spectrum", "temperature",
}  # fmt: skip


def test_dir_is_complete_and_every_name_is_there():
    assert set(run("import jaxcal; print(*(n for n in dir(jaxcal) if not n.startswith('_')))").split()) == PUBLIC
    assert all(getattr(jaxcal, name) is not None for name in PUBLIC)


def test_type_checkers_see_the_public_names():
    tree = ast.parse(inspect.getsource(jaxcal))
    seen = {alias.asname for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names if alias.asname}
    assert seen == PUBLIC


def parameters(thing):
    """Names and annotations of the parameters and fields of a public function or class, as its source has them."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(inspect.unwrap(thing)))).body
    for node in tree.body if isinstance(tree, ast.ClassDef) else [tree]:
        if isinstance(node, ast.AnnAssign):
            yield f"{tree.name}.{node.target.id}", node.annotation
        elif isinstance(node, ast.FunctionDef) and (node.name == "__init__" or not node.name.startswith("_")):
            given = [one for one in ast.walk(node.args) if isinstance(one, ast.arg) and one.arg not in ("self", "cls")]
            yield from ((f"{tree.name}.{node.name}.{one.arg}", one.annotation) for one in given)


def test_public_parameters_have_types():
    parts = [getattr(jaxcal, part) for part in PUBLIC if inspect.ismodule(getattr(jaxcal, part))]
    things = [getattr(part, name) for part in parts for name in dir(part) if not name.startswith("_")]
    found = [one for thing in things if inspect.isroutine(thing) or inspect.isclass(thing) for one in parameters(thing)]
    bare = [name for name, type in found if type is None or "Any" in ast.unparse(type).split(" | ")]
    assert len(found) > 1000
    assert len(bare) <= 0.05 * len(found), bare


def test_version_is_the_installed_one():
    assert jaxcal.__version__ == importlib.metadata.version("jaxcal")
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    assert f"Python {needed.removeprefix('>=')} or newer. " in (ROOT / "README.md").read_text()


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'jaxcal' has no attribute 'magic'"):
        jaxcal.magic  # noqa: B018


def test_errors_are_value_errors():
    for name in ("DataError", "ExportError", "FitError", "UnitError"):
        assert issubclass(getattr(jaxcal, name), jaxcal.JaxcalError)
    assert issubclass(jaxcal.JaxcalError, ValueError)


def test_the_lines_of_the_readme_run(tmp_path, monkeypatch):
    code = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[1]
    record = jaxcal.noise.Noise(N=1e-4).simulate(1000, rate=100.0, seed=0)
    rows = "".join(f"{i / 100},{x:.9g},{-x:.9g},{x:.9g}\n" for i, x in enumerate(record))
    (tmp_path / "jaxcal-demo").mkdir()
    (tmp_path / "jaxcal-demo" / "imu.csv").write_text("time [s],gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s]\n" + rows)
    monkeypatch.chdir(tmp_path)
    exec(code, {})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["allan.png", "device.json", "jaxcal-demo"]


def test_ci_runs_the_commands_of_the_readme():
    """The script takes its commands from the README; each of its patterns must match exactly the intended command."""
    readme, script = (ROOT / "README.md").read_text(), (ROOT / ".ci" / "run").read_text()
    patterns = re.findall(r"grep -m1 (?:-- )?'([^']+)' \"\$root/README.md\"", script)
    assert patterns == ["-m pytest", "bin/jaxcal demo"]
    block = "\n".join(re.findall(r"^```\n(.*?)^```", readme, re.DOTALL | re.MULTILINE)).splitlines()
    for pattern in patterns:
        found = [line for line in readme.splitlines() if pattern in line]
        assert len(found) == 1
        assert found[0] in block
        assert found[0].startswith("python3.11 -m venv .venv && .venv/bin/pip install ")
    assert " && (cd" in next(line for line in block if "-m pytest" in line)  # here the script separates the installation
    assert os.access(ROOT / ".ci" / "run", os.X_OK)


def test_hooks_run_what_ci_runs():
    yaml = pytest.importorskip("yaml")
    (repository,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    script = (ROOT / ".ci" / "run").read_text()
    readme = (ROOT / "README.md").read_text()
    assert [hook["id"] for hook in repository["hooks"]] == ["ruff", "ruff-format", "lint-imports", "pyright", "pytest"]
    for hook in repository["hooks"]:
        assert re.search(rf"^\s*{hook['entry']}$", script, re.MULTILINE) or hook["entry"] in readme


def test_every_extra_is_part_of_all_or_a_tool_of_ours_or_left_out_on_purpose():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert extras["all"] == [
        f"jaxcal[{','.join(name for name in extras if name not in ('all', 'test', 'bench', 'dask', 'docs', 'notebooks'))}]"
    ]
