"""What makes a command quick: JAX's persistent compilation cache."""

import os
import sys
from pathlib import Path


def cache_folder() -> Path:
    """The user's cache folder for compiled programs: XDG_CACHE_HOME, or the custom of the platform."""
    if configured := os.environ.get("XDG_CACHE_HOME"):
        base = Path(configured)
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path.home() / ".cache"
    return base / "jaxcal" / "xla"


def keep_compiled() -> None:
    """Switch the cache on for this process.

    A folder of the user's own (JAX_COMPILATION_CACHE_DIR) is left in force. Where the cache folder cannot be written the
    command goes on without it and without a word: it costs seconds, never a result.
    """
    import warnings

    import jax

    from .._compile import keep_programs

    # a disk that is full, or an entry that another process is just writing, costs seconds and no result
    warnings.filterwarnings("ignore", message="Error (writing|reading) persistent compilation cache entry")
    if jax.config.values["jax_compilation_cache_dir"] is None:
        try:
            folder = cache_folder()
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, RuntimeError):  # RuntimeError: no home folder
            return
        if not os.access(folder, os.W_OK):
            return
        jax.config.update("jax_compilation_cache_dir", str(folder))
        keep_programs(folder)
    # the kernels are many and small: with JAX's own limits most of them would be compiled anew in every run
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
