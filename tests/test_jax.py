"""What jaxcal uses of JAX beyond its documented interface. If a test fails with a new JAX, do what its docstring says."""

import ast
import os
import pathlib
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal import _jax

PRIVATE = ("jax._src", "jaxlib", "jax.extend", "jax.experimental.xla", "jax.interpreters")
PACKAGE = pathlib.Path(_jax.__file__).parent


def test_only_one_module_uses_what_is_not_documented():
    """Move the import, the setting or the option of XLA to `_jax.py`, and give it a test here."""
    for path in PACKAGE.rglob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        names = [getattr(node, "module", None) or "" for node in nodes]
        attributes = [node for node in nodes if isinstance(node, ast.Attribute)]
        names += [f"jax._src.{node.attr}" for node in attributes if ast.unparse(node) in ("jax.config.read", "jax.config.values")]
        names += ["jaxlib" for node in nodes if isinstance(node, ast.Constant) and str(node.value).lstrip("-").startswith("xla_")]
        private = [name for name in names if name.startswith(PRIVATE)]
        assert path.name == "_jax.py" or not private, (path, private)


def test_a_trace_is_seen():
    """`get_opaque_trace_state` must differ between traces: else drop `_untraced`, at 30 us for each call of `is_traced`."""
    seen = []
    jax.jit(lambda x: seen.append((_jax.is_traced(x), _jax.is_traced())) or x)(1.0)
    jax.grad(lambda x: seen.append((_jax.is_traced(x), _jax.is_traced())) or x)(1.0)
    assert [*seen, (_jax.is_traced(1.0), _jax.is_traced())] == [(True, True), (True, False), (False, False)]


def test_a_start_is_seen():
    """`_backends` has another name: find what `jax.devices` fills. Without it a forked child waits for ever instead of saying so."""
    code = "import jax; from jaxcal._jax import has_started as s; a = s(); jax.numpy.ones(1); print(a, s())"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False True\n"


def test_the_options_of_the_compiler_are_known():
    """XLA dropped an option: see whether the programs of today compile as fast without it, and keep it for older versions alone."""
    assert _jax.is_quick() == (jax.default_backend() == "cpu")
    assert jax.jit(lambda x: x + 1, compiler_options=_jax.WIDE | _jax.ROUGH)(1.0) == 2.0
    code = "import jax; print(jax.numpy.ones(1)[0])"  # XLA ends a process for a flag that it does not know
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ | {"XLA_FLAGS": _jax.ONE_THREAD})

    def refused(x):
        raise jax.errors.JaxRuntimeError("no such option")

    with pytest.raises(jax.errors.JaxRuntimeError):  # which all options of `QUICK` are not
        _jax.quickly(refused, lambda x: x, 1.0)
    assert _jax.quickly(lambda x: 2 * x, lambda x: x, 1.0) == 2.0
    settings = dict(_jax.settings())
    assert settings["jax_enable_x64"] == "True"
    assert not [name for name in settings if "cache" in name]


def test_a_kernel_is_marked():
    """The attribute has another name: find it in XLA's `small call` pass; unmarked loops cost 0.1 us for each operation."""
    marked = jax.jit(lambda x: _jax.as_one_kernel(jax.jit(jnp.sin)(x)))
    assert 'xla_cpu_small_call = "true"' in marked.lower(1.0).as_text()


def test_a_program_is_stored_and_restored():
    """Serialisation changed: `_programs.py` may compile every time until it works again, since every failure there only costs time."""
    matrix = np.array([[2.0, 1.0], [1.0, 3.0]])
    with _jax.no_entry():
        program = jax.jit(jnp.linalg.inv).lower(matrix).compile()
    code = _jax.stored(program)
    again = _jax.restored(code, jax.tree.structure(((0,), {})), jax.tree.structure(0))
    assert b"lapack" in code  # else the routines need no loading
    np.testing.assert_allclose(again(matrix) @ matrix, np.eye(2), atol=1e-12)
