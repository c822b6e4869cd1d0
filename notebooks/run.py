"""Run the notebooks and store them with their output, so that they open on GitHub with their pictures: python notebooks/run.py [NAME ...].

All run in one kernel, cleared in between: most of their time is JAX compiling programs, and that way none is compiled twice.
"""

import base64
import contextlib
import hashlib
import io
import os
import pathlib
import sys
import tempfile

import nbclient
import nbformat

FOLDER = pathlib.Path(__file__).resolve().parent
# a notebook compiles for longer than it computes: the optimiser costs more than it gains
FLAGS = "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
_CLEAR = """%reset -f
import os, warnings
import jax
os.chdir({folder!r})
warnings.resetwarnings()
jax.config.update("jax_enable_x64", False)
"""


@contextlib.contextmanager
def kernel(**environment):
    """A client with a running kernel, in an environment with these variables besides."""
    with tempfile.TemporaryDirectory() as home:
        # the package beside this folder, also where another copy of it is installed
        path = os.pathsep.join(filter(None, (str(FOLDER.parent), os.environ.get("PYTHONPATH"))))
        added = {"XLA_FLAGS": os.environ.get("XLA_FLAGS", FLAGS), "IPYTHONDIR": home, "PYTHONPATH": path, **environment}
        before = {name: os.environ.get(name) for name in added}
        os.environ.update(added)
        client = nbclient.NotebookClient(nbformat.v4.new_notebook(), timeout=300, kernel_name="python3", coalesce_streams=True)
        try:
            client.execute(cleanup_kc=False)
            yield client
        finally:
            client.nb = nbformat.v4.new_notebook()
            client.execute()
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.update({name: value})


def run(client, notebook, folder):
    """Run every cell, in a folder, as if the kernel were new; raises where a cell does."""
    first = nbformat.v4.new_code_cell(_CLEAR.format(folder=str(folder)))
    notebook.cells.insert(0, first)
    client.nb = notebook
    try:
        client.execute(cleanup_kc=False)
    finally:
        notebook.cells.remove(first)


def sources(notebook):
    """What tells whether stored output belongs to the code beside it."""
    code = "\0".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    return hashlib.sha256(code.encode()).hexdigest()[:16]


def tidy(notebook):
    """Counts from one, no times, small pictures."""
    count = 0
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            count += 1
            cell.execution_count = count
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
            for output in cell.outputs:
                if "execution_count" in output:
                    output.execution_count = count
                if "image/png" in output.get("data", {}):
                    output.data["image/png"] = _small(output.data["image/png"])
    notebook.metadata["jaxcal"] = {"sources": sources(notebook)}


def _small(picture):
    from PIL import Image

    with Image.open(io.BytesIO(base64.b64decode(picture))) as image:
        few = image.convert("RGB").quantize(64)
        buffer = io.BytesIO()
        few.save(buffer, "PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()


def main(names):
    """Run and store those that are named, or all."""
    with tempfile.TemporaryDirectory() as folder, kernel() as client:
        for path in sorted(FOLDER.glob("*.ipynb")):
            if names and path.stem not in names:
                continue
            notebook = nbformat.read(path, as_version=4)
            place = pathlib.Path(folder, path.stem)
            place.mkdir()
            run(client, notebook, place)
            tidy(notebook)
            nbformat.write(notebook, path)
            first = next(
                (output for cell in notebook.cells for output in cell.get("outputs", ()) if "image/png" in output.get("data", {})), None
            )
            if first is not None:  # the pages of the documentation show it
                (FOLDER / "pictures" / f"{path.stem}.png").write_bytes(base64.b64decode(first.data["image/png"]))
            print(path.name, path.stat().st_size // 1000, "kB", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
