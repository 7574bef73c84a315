"""Compiled programs, kept between starts: compiling takes longer than most reconstructions.

Several processes may share a folder. JAX writes a program once and then only reads it; one that is
not there any more, or cannot be read, is compiled again: without a warning, since it writes in
place, and another process may read what is half written.
"""

import atexit
import os
import sys
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import jax

MOST_BYTES = 500e6  # of programs in the folder; those that were not used for longest go
HALF_WRITTEN = "Error reading persistent compilation cache entry"  # of JAX's warning
PROGRAMS = "*-cache"  # files that JAX writes, as opposed to what else a folder may hold


def keep_programs(folder: str | None, *, off: bool = False) -> None:
    """Let JAX keep programs in ``folder``; by default the one it already uses, or `user_folder`.

    There are at most `MOST_BYTES` of them when the process begins, and when it ends. If the user's
    folder cannot be made or written, programs are just not kept.

    Raises:
        ValueError: for a ``folder`` that is given and cannot be made or written.
    """
    if off:
        jax.config.update("jax_enable_compilation_cache", False)
        return
    # programs of the first steps are small, but many
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    if folder is not None:
        if not _is_writable(Path(folder)):
            raise ValueError(
                f"--cache {folder} cannot be written: give another folder, or --no-cache."
            )
        _keep_in(Path(folder))
    elif jax.config.jax_compilation_cache_dir is None:  # pyright: ignore[reportAttributeAccessIssue]
        own = user_folder(os.environ, sys.platform)
        if _is_writable(own):
            _keep_in(own)


def _is_writable(folder: Path) -> bool:
    """Whether programs can be kept there, in a folder that is made if there is none."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.R_OK | os.W_OK | os.X_OK)


def _keep_in(folder: Path) -> None:
    jax.config.update("jax_compilation_cache_dir", str(folder))
    warnings.filterwarnings("ignore", message=HALF_WRITTEN)
    remove_oldest(folder, MOST_BYTES)
    atexit.register(remove_oldest, folder, MOST_BYTES)


def user_folder(environment: Mapping[str, str], platform: str) -> Path:
    """The user's cache folder on this platform.

    >>> user_folder({"XDG_CACHE_HOME": "/scratch"}, "linux").as_posix()
    '/scratch/jaxtat'
    """
    if platform == "win32":
        default = Path(environment.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif platform == "darwin":
        default = Path.home() / "Library" / "Caches"
    else:
        default = Path(environment.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return default / "jaxtat"


def remove_oldest(folder: Path, most_bytes: float) -> None:
    """Remove programs, those first that were not used for longest, until few enough bytes are left.

    Other processes may do so at the same time.
    """
    files = []
    for path in folder.glob(PROGRAMS):
        with suppress(OSError):
            status = path.stat()
            files.append((max(status.st_atime, status.st_mtime), status.st_size, path))
    total = 0
    for _, size, path in sorted(files, reverse=True):
        total += size
        if total > most_bytes:
            with suppress(OSError):
                path.unlink()
