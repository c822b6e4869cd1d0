"""In a process forked from one that has used JAX, jaxcal raises an error instead of waiting forever."""

import os
import subprocess
import sys
import textwrap

import pytest

CODE = """
    import os, warnings
    import numpy as np
    import jaxcal
    warnings.simplefilter("ignore")
    y = np.random.default_rng(0).normal(size=500)
    jaxcal.allan.deviation(y, 100.0, m=[1, 2])
    child = os.fork()
    if child == 0:
        try:
            jaxcal.allan.deviation(y, 100.0, m=[1, 2])
        except jaxcal.DataError as error:
            print(error, flush=True)
        os._exit(0)
    os.waitpid(child, 0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not forked here")
def test_a_computation_in_a_forked_child_ends_in_a_sentence():
    found = subprocess.run([sys.executable, "-c", textwrap.dedent(CODE)], capture_output=True, text=True, timeout=100, check=False)
    assert "this process was forked from one in which JAX had already computed" in found.stdout, found.stderr[-2000:]
    assert 'multiprocessing.get_context("spawn")' in found.stdout
