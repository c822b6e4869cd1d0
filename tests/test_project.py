"""The repository as a whole: examples of every public name, a short README, issue forms, workflows, and the same version everywhere."""

import ast
import contextlib
import importlib
import inspect
import json
import pathlib
import pkgutil
import re
import subprocess
import sys
import tomllib

import pytest

import jaxcal

ROOT = pathlib.Path(__file__).resolve().parents[1]
PACKAGES = [module.name for module in pkgutil.iter_modules(jaxcal.__path__) if module.ispkg]
PARTS = ["jaxcal", *(f"jaxcal.{name}" for name in PACKAGES if name != "cli" and not name.startswith("_"))]


def public(part):
    """Classes and functions that a package exports."""
    module = importlib.import_module(part)
    names = [name for name in dir(module) if not name.startswith("_")] if part != "jaxcal" else ["Calibration", "Log", "read"]
    found = {name: getattr(module, name) for name in names}
    return {name: one for name, one in found.items() if inspect.isclass(one) or inspect.isroutine(one)}


@pytest.mark.parametrize("part", PARTS)
def test_every_public_name_has_an_example(part):
    without = [name for name, one in public(part).items() if ">>>" not in (inspect.getdoc(one) or "")]
    assert without == []


def test_the_readme_fits_on_three_screens():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) < 120


def modules():
    """Path, text and syntax tree of every module of the package."""
    for path in sorted((ROOT / "jaxcal").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        yield path, text, ast.parse(text)


def code_lines(text, tree):
    """Number of lines without blank ones, comments and docstrings."""
    told = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Module) and ast.get_docstring(node, clean=False):
            told |= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    kept = (line.strip() for number, line in enumerate(text.splitlines(), 1) if number not in told)
    return sum(bool(line) and not line.startswith("#") for line in kept)


def numeric_constants(tree):
    """Number of statements of a module that give a name to a number, or to what holds one."""
    stated = [node.value for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None]
    return sum(any(isinstance(one, ast.Constant) and type(one.value) in (int, float) for one in ast.walk(value)) for value in stated)


def test_the_package_stays_small():
    found = list(modules())
    assert [str(path) for path, text, _ in found if len(text.splitlines()) > 400] == []
    assert sum(len(public(part)) for part in PARTS) <= 190
    assert sum(code_lines(text, tree) for _, text, tree in found) <= 34_500
    assert sum(numeric_constants(tree) for _, _, tree in found) <= 450
    assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in (ROOT / "tests").rglob("*.py")) <= 25_000


def imports_of(path, tree):
    """Modules of the package that a module imports when it is loaded, and not in a function or for type checkers alone."""
    package = ["jaxcal", *path.relative_to(ROOT / "jaxcal").parent.parts]
    waiting = list(tree.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1] + (node.module or "").split(".") * bool(node.module)
            yield from (".".join([*base, one.name]) for one in node.names)
            yield ".".join(base)
        elif isinstance(node, ast.ClassDef | ast.Try | ast.With):
            waiting += node.body
        elif isinstance(node, ast.If):
            waiting += node.orelse if "TYPE_CHECKING" in ast.unparse(node.test) else [*node.body, *node.orelse]


def test_no_modules_import_one_another_in_a_circle():
    known = {}
    for path, _, tree in modules():
        parts = path.relative_to(ROOT).with_suffix("").parts
        known[".".join(parts).removesuffix(".__init__")] = set(imports_of(path, tree))
    # a package as a whole is loaded before its parts, and imports them
    graph = {name: {one for one in found if one in known and not name.startswith(f"{one}.")} - {name} for name, found in known.items()}
    with contextlib.suppress(StopIteration):
        while True:  # take away what imports nothing that is left
            free = next(name for name, found in graph.items() if not found & graph.keys())
            del graph[free]
    assert sorted(graph) == []


def test_type_checkers_are_told_that_there_are_types():
    assert (ROOT / "jaxcal" / "py.typed").exists()


def test_one_version_everywhere():
    yaml = pytest.importorskip("yaml")
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["version"] == version


def test_workflows_run_what_contributors_run():
    yaml = pytest.importorskip("yaml")
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))["jobs"]
    everything, alone = jobs["everything"], jobs["tests"]
    assert everything["strategy"]["matrix"]["python"] == ["3.11", "3.12", "3.13"]
    assert ".ci/run" in [step.get("run") for step in everything["steps"]]
    assert alone["strategy"]["matrix"]["os"] == ["macos-latest", "windows-latest"]
    assert "python -m pytest" in [step.get("run") for step in alone["steps"]]


def test_forms_ask_for_a_log_and_for_what_info_says():
    yaml = pytest.importorskip("yaml")
    for name in ("problem", "format"):
        form = yaml.safe_load((ROOT / ".github" / "ISSUE_TEMPLATE" / f"{name}.yml").read_text(encoding="utf-8"))
        wanted = {item["id"]: item for item in form["body"] if item.get("validations", {}).get("required")}
        assert {"info", "log"} <= set(wanted)
        assert "jaxcal info LOG" in wanted["info"]["attributes"]["label"]


def pyright(*words, cwd):
    """Output of pyright as JSON."""
    found = subprocess.run([sys.executable, "-m", "pyright", "--outputjson", *words], cwd=cwd, capture_output=True, text=True, check=False)
    return json.loads(found.stdout)


@pytest.mark.long
def test_types_of_the_interface_are_known(tmp_path):
    found = pyright("--verifytypes", "jaxcal", "--ignoreexternal", cwd=tmp_path)["typeCompleteness"]
    unknown = [symbol["name"] for symbol in found["symbols"] if symbol["isExported"] and not symbol["isTypeKnown"]]
    assert found["completenessScore"] == 1, unknown


@pytest.mark.long
def test_a_strict_checker_finds_nothing_in_a_script_of_the_readme(tmp_path):
    for page in ("README.md", "docs/quickstart.md"):
        code = re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)
        (tmp_path / f"{pathlib.Path(page).stem.lower()}_script.py").write_text("\n".join(code))
    (tmp_path / "pyrightconfig.json").write_text('{"typeCheckingMode": "strict", "pythonVersion": "3.11"}')
    found = pyright(cwd=tmp_path)
    assert found["summary"]["filesAnalyzed"] == 2
    assert [one["message"] for one in found["generalDiagnostics"]] == []
