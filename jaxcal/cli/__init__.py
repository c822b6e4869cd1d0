"""The `jaxcal` command: thin commands around the library, without numerics."""

import atexit
import gc
import os
import sys


def main(argv: list[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    argv : words after the name of the program; the default is the command line of this process.

    Returns
    -------
    int
        0: done; 1: the data do not allow a result; 2: the call was wrong; 3: a fault in jaxcal itself; 130: interrupted;
        141: the reader of the output closed the pipe. The reason is printed on standard error.

    Examples
    --------
    >>> from jaxcal.cli import main
    >>> main(["noise", "missing.csv"])
    2
    """
    # the other threads of OpenBLAS wait in a loop: they give nothing to matrices of this size, and can take several times the work itself
    if "numpy" not in sys.modules and "OMP_NUM_THREADS" not in os.environ:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from ._app import run
    except ModuleNotFoundError as missing:
        if (missing.name or "").partition(".")[0] not in ("cyclopts", "rich"):
            raise
        print('The jaxcal command needs two small packages more; install them with: pip install "jaxcal[cli]"', file=sys.stderr)
        return 2
    # imports and traced programs keep a million objects alive; frequent garbage collection would take a tenth of the time of a command,
    # and the last collection, when the interpreter ends, as long again
    before = gc.get_threshold()
    atexit.unregister(gc.freeze)
    atexit.register(gc.freeze)
    gc.set_threshold(200_000, 50, 100)
    try:
        return run(sys.argv[1:] if argv is None else argv)
    finally:
        gc.set_threshold(*before)
