"""What MkDocs does beside its plugins: formulas as MathML, pictures of the notebooks, pages of the interface.

Formulas are written as GitHub shows them, a block in a fence named math and $`x`$ in a line, so that the pages read well there too.
"""

import ast
import pathlib
import posixpath
import re

import latex2mathml.converter
from mkdocs.structure.files import File

ROOT = pathlib.Path(__file__).resolve().parents[1]
REPOSITORY = "https://github.com/jaxcal/jaxcal/blob/main"
PICTURES = "notebooks/pictures"
PARTS = {
    "jaxcal": (
        "Logs and devices",
        ("Log", "read", "Calibration", "JaxcalError", "DataError", "UnitError", "FitError", "ExportError", "PrecisionWarning"),
    ),
    "jaxcal.allan": ("Allan family", None),
    "jaxcal.spectrum": ("Spectra", None),
    "jaxcal.noise": ("Noise", None),
    "jaxcal.temperature": ("Temperature", None),
    "jaxcal.imu": ("Accelerometer and gyroscope", None),
    "jaxcal.magnetometer": ("Magnetometer", None),
    "jaxcal.evidence": ("Evidence: what in a log is not the sensor", None),
    "jaxcal.device": ("A whole device", None),
    "jaxcal.alignment": ("Alignment", None),
    "jaxcal.calibration": ("Calibration of a device", None),
    "jaxcal.budget": ("Error budgets", None),
    "jaxcal.io": ("Reading and converting", None),
    "jaxcal.export": ("Export", None),
    "jaxcal.batch": ("Many logs", None),
    "jaxcal.fitting": ("Models of your own", None),
    "jaxcal.plot": ("Figures", None),
    "jaxcal.report": ("Reports", None),
}


def on_config(config):
    """Add the pages of the interface to the navigation."""
    config.nav.append({"Interface": [{title: f"api/{_page(part)}"} for part, (title, _) in PARTS.items()]})
    return config


def on_files(files, config):
    """Add the pages of the interface, and the pictures of the notebooks."""
    for part, (title, names) in PARTS.items():
        members = "\n\n".join(f"::: {part}.{name}" for name in names or _public(part))
        about = ast.get_docstring(ast.parse(_source(part).read_text(encoding="utf-8"))).split("\n")[0]
        head = f"# {title}\n\n`{part}`: {about[0].lower() + about[1:] if part != 'jaxcal' else about}\n\n"
        files.append(File.generated(config, f"api/{_page(part)}", content=head + members))
    for picture in sorted((ROOT / PICTURES).glob("*.png")):
        files.append(File.generated(config, f"pictures/{picture.name}", abs_src_path=str(picture)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Formulas, and links that leave the folder of the pages."""
    depth = posixpath.relpath(".", posixpath.dirname(page.file.src_uri) or ".")
    # Markdown would take MathML for a block of its own, so that it comes in when Markdown is done
    page.formulas = []
    markdown = re.sub(r"```math\n(.*?)\n```", lambda found: _kept(page.formulas, found[1], "block"), markdown, flags=re.DOTALL)
    markdown = re.sub(r"\$`([^`]+)`\$", lambda found: _kept(page.formulas, found[1], "inline"), markdown)
    markdown = re.sub(r"\]\((?:\.\./)+notebooks/pictures/", f"]({depth}/pictures/", markdown)
    here = pathlib.Path("docs", posixpath.dirname(page.file.src_uri))

    def outside(found):
        target = posixpath.normpath(posixpath.join(here.as_posix(), found[1]))
        if target.startswith(("docs/", "..")):
            return found[0]
        if not (ROOT / target).exists():
            raise FileNotFoundError(f"{page.file.src_uri} links to {target}, which is not there")
        return f"]({REPOSITORY}/{target}{found[2]})"

    return re.sub(r"\]\(((?:\.\./)+[^)#]+)(#[^)]*|)\)", outside, markdown)


def on_page_content(html, page, config, files):
    """Formulas in their places."""
    html = re.sub(r"<p>(FORMULA\d+BLOCK)</p>", r"\1", html)
    return re.sub(r"FORMULA(\d+)(?:BLOCK|INLINE)", lambda found: page.formulas[int(found[1])], html)


def _kept(formulas, formula, display):
    made = latex2mathml.converter.convert(" ".join(formula.split()), display=display)
    formulas.append(f'<div class="formula">{made}</div>' if display == "block" else made)
    return f"FORMULA{len(formulas) - 1}{display.upper()}"


def _page(part):
    return f"{part.rpartition('.')[2] if '.' in part else 'index'}.md"


def _source(part):
    return ROOT / pathlib.Path(*part.split(".")) / "__init__.py"


def _public(part):
    """Names that the package exports, as `from ._module import name as name`; a lazy package does so for type checkers alone."""
    tree = ast.parse(_source(part).read_text(encoding="utf-8"))
    found = [name.asname for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for name in node.names if name.asname == name.name]
    if not found:
        raise LookupError(f"{part} exports no name, so that its page would be empty")
    return sorted(found, key=str.lower)
