"""The folder of compiled programs, which makes commands fast; it is limited in size, and `jaxcal cache --clear` empties it."""

import contextlib
import os
import sys
from pathlib import Path
from typing import Annotated, NamedTuple

from cyclopts import Parameter

from ._options import CallError, Quiet
from ._screen import Screen

#: largest size of the folder in bytes; the programs of one command need a hundredth of it
BOUND = 200_000_000


def cache(
    *,
    clear: Annotated[bool, Parameter(help="Remove all of them; the next command of each kind compiles for some seconds.")] = False,
    quiet: Quiet = False,
) -> None:
    """Show the folder of compiled programs and its size.

    The first command of each kind compiles its programs, which takes seconds;
    later commands find them in this folder. Beyond 200 MB, jaxcal removes the
    programs that were not used for the longest time.
    """
    screen = Screen(quiet)
    if own := os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        if clear:
            raise CallError(
                f"the folder {own} is your own (JAX_COMPILATION_CACHE_DIR), so jaxcal does not clear it; remove its files yourself"
            )
        screen.line(f"Compiled programs are kept in {own}, which JAX_COMPILATION_CACHE_DIR names. jaxcal neither bounds nor clears it.")
        return
    folder = cache_folder()
    found = _entries(folder)
    size = sum(entry.size for entry in found)
    if clear:
        for entry in found:
            entry.path.unlink(missing_ok=True)
    screen.lines([f"{folder}: {len(found)} files, {size / 1e6:.1f} MB{', removed' if clear else f' of at most {BOUND / 1e6:.0f} MB'}"])


class _Entry(NamedTuple):
    """A file of the cache: time of its last use, size, and path."""

    used: float
    size: int
    path: Path


def _entries(folder: Path) -> list[_Entry]:
    """The programs in the folder; other files are ignored."""
    found = []
    with contextlib.suppress(OSError), os.scandir(folder) as files:
        for file in files:
            if file.name.endswith(("-cache", "-atime")):
                with contextlib.suppress(OSError):  # another process may have removed it
                    known = file.stat(follow_symlinks=False)
                    found.append(_Entry(max(known.st_atime, known.st_mtime), known.st_size, Path(file.path)))
    return found


def bound(folder: Path, limit: int = BOUND) -> None:
    """If the folder has more than `limit` bytes, remove the programs that were not used for the longest time."""
    found = sorted(_entries(folder))
    size = sum(entry.size for entry in found)
    for entry in found:
        if size <= limit:
            break
        with contextlib.suppress(OSError):
            entry.path.unlink()
            size -= entry.size


def cache_folder() -> Path:
    """The user's cache folder for compiled programs: below XDG_CACHE_HOME, or the usual place of the platform."""
    configured = Path(os.environ.get("XDG_CACHE_HOME") or ".")
    if configured.is_absolute():  # a relative one is ignored, as its specification says
        base = configured
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path.home() / ".cache"
    return base / "jaxcal" / "xla"


def keep_compiled() -> None:
    """Switch on the cache for this process.

    A folder set by the user (JAX_COMPILATION_CACHE_DIR) stays in effect. If the cache folder cannot be written, the command continues
    without it and without a warning, because this costs seconds but never a result.
    """
    import warnings

    import jax

    from .._compile import keep_programs
    from .._jax import setting

    # a full disk, or an entry that another process is writing, costs seconds but no result
    warnings.filterwarnings("ignore", message="Error (writing|reading) persistent compilation cache entry")
    if setting("jax_compilation_cache_dir") is None:
        try:
            folder = cache_folder()
            folder.parent.parent.mkdir(parents=True, exist_ok=True)
            for part in (folder.parent, folder):
                part.mkdir(mode=0o700, exist_ok=True)
        except (OSError, RuntimeError):  # RuntimeError: no home folder
            return
        # the programs are run as they are: of a folder that others may write, nothing is loaded
        held = [part.stat() for part in (folder.parent, folder)]
        if not os.access(folder, os.W_OK) or (os.name == "posix" and any(one.st_uid != os.getuid() or one.st_mode & 0o022 for one in held)):
            return
        bound(folder)
        jax.config.update("jax_compilation_cache_dir", str(folder))
        keep_programs(folder)
    # the programs are many and small: with JAX's default limits most would be compiled again in every run
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
