"""The pages of docs/: their links and the names in them exist, and their code is valid Python."""

import ast
import importlib
import json
import pathlib
import re
import shlex
import subprocess
import sys
import types

import jax
import numpy as np
import pytest

from jaxcal.cli import main

ROOT = pathlib.Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
COMMANDS = (
    "demo", "noise", "allan", "psd", "temperature", "imu", "mag", "device", "north", "apply", "convert", "export", "diff", "info", "batch",
    "simulate", "cache", "rate-table", "budget", "sheet",
)  # fmt: skip


def name(page):
    return page.relative_to(ROOT).as_posix()


def test_there_are_pages():
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    listed = re.findall(r": ([a-z_/]+\.md)$", settings, re.MULTILINE)
    assert sorted(listed) == [page.relative_to(ROOT / "docs").as_posix() for page in PAGES]


@pytest.mark.parametrize("page", [*PAGES, *(ROOT / f"{title}.md" for title in ("README", "CONTRIBUTING", "CHANGELOG"))], ids=name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if target.startswith(("https://", "http://")):
            continue
        place = (page.parent / target).resolve()
        made = re.fullmatch(r"api/(\w+)\.md", place.relative_to(ROOT / "docs").as_posix()) if place.is_relative_to(ROOT / "docs") else None
        if made:  # written by docs/hooks.py
            importlib.import_module(f"jaxcal.{made[1]}")
        else:
            assert place.exists(), target


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_names_are_there(page):
    text = page.read_text(encoding="utf-8")
    for dotted in set(re.findall(r"\bjaxcal((?:\.[A-Za-z_]\w*)+)", text)):
        found = importlib.import_module("jaxcal")
        for part in dotted.strip(".").split("."):
            found = getattr(found, part)
    code = " ".join(re.findall(r"```[a-z]*\n.*?```|`[^`\n]+`", text, re.DOTALL))
    for command in re.findall(r"(?:^|`|venv/bin/)jaxcal (\w[\w-]*)", code, re.MULTILINE):
        assert command in (*COMMANDS, "COMMAND"), command


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_code_is_python(page):
    for code in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
        ast.parse(code)


@pytest.mark.long
def test_differentiable_experiments_run():
    """The examples of the page, one after the other as one program, and what the text says of their numbers."""
    codes = re.findall(r"```python\n(.*?)```", (ROOT / "docs/tasks/differentiable.md").read_text(encoding="utf-8"), re.DOTALL)
    found = {}
    with jax.numpy_dtype_promotion("standard"):
        exec("\n".join(codes), found)
    assert abs(found["influence"]).argmax() == 700
    assert found["value"] < found["first"] - np.log(2)
    assert found["slope"].sum() == pytest.approx(-1.0, rel=1e-3)
    assert 0 < found["gain"] < 1


ANSWER = re.compile(r"```\n(jaxcal .*?)\n```\n\nprints, for the log of `(.*?)`,\n\n```text\n(.*?)```", re.DOTALL)
NUMBER = r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?"


@pytest.mark.long
@pytest.mark.parametrize("page", ["noise", "imu", "magnetometer", "temperature", "north", "device"])
def test_a_task_begins_with_the_call_and_what_it_prints(page, tmp_path, monkeypatch, capsys):
    """The same words, and each value within the half-width that the page shows."""
    call, simulation, answer = ANSWER.search((ROOT / "docs" / "tasks" / f"{page}.md").read_text(encoding="utf-8")).groups()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    assert [main(shlex.split(one)[1:]) for one in (simulation, call)] == [0, 0]
    printed = {re.sub(rf"{NUMBER}|\s+", "", line): line for line in capsys.readouterr().out.splitlines()[::-1]}
    for line in filter(lambda line: line not in ("", "..."), answer.splitlines()):
        now = printed[re.sub(rf"{NUMBER}|\s+", "", line)]
        pairs = (re.findall(rf"({NUMBER}) ± ({NUMBER})", one) for one in (line, now))
        for (shown, half), (value, _) in zip(*pairs, strict=True):
            assert abs(float(shown) - float(value)) <= float(half), line


def test_pages_of_the_interface_follow_the_packages():
    """Every package with public names has a page. The test reads the list from docs/hooks.py, without the packages of the site."""
    tree = ast.parse((ROOT / "docs" / "hooks.py").read_text(encoding="utf-8"))
    parts = next(ast.literal_eval(node.value) for node in tree.body if isinstance(node, ast.Assign) and node.targets[0].id == "PARTS")
    packages = {f"jaxcal.{path.parent.name}" for path in (ROOT / "jaxcal").glob("[a-z]*/__init__.py")}
    assert set(parts) == {"jaxcal"} | packages - {"jaxcal.cli"}
    for part in set(parts) - {"jaxcal"}:  # a page lists what its package imports under its own name
        tree = ast.parse((ROOT / part.replace(".", "/") / "__init__.py").read_text(encoding="utf-8"))
        imports = [alias for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names]
        shown, package = {alias.asname for alias in imports if alias.asname == alias.name}, importlib.import_module(part)
        named = {one for one in dir(package) if not one.startswith("_")}
        assert shown == {one for one in named if not isinstance(getattr(package, one), types.ModuleType)}, part


def test_docstrings_become_markdown():
    """Sections of numpydoc become Markdown. The code runs in a separate process without griffe, which only the site needs."""
    source = "One line, a*b.\n\n        S = 1\n\nParameters\n----------\ny : (n,) readings < 3,\n    in rad/s.\na, b : two of them.\n\n"
    source += "Examples\n--------\n>>> f(1)\n2\n"
    code = (ROOT / "docs" / "docstrings.py").read_text(encoding="utf-8")
    code = code.replace("import griffe\nimport latex2mathml.converter\n", "").replace("griffe.Extension", "object")
    script = f"{code}\nimport json\nprint(json.dumps(numpydoc({source!r})))"
    made = json.loads(subprocess.run([sys.executable, "-c", script], capture_output=True, check=True, text=True).stdout)
    assert made == (
        "One line, a\\*b.\n\n```text\n        S = 1\n```\n\n**Parameters**\n\n- `y`: (n,) readings \\< 3, in rad/s.\n"
        "- `a`, `b`: two of them.\n\n**Examples**\n\n```pycon\n>>> f(1)\n2\n```"
    )
