"""Compiled programs, kept between starts: compiling takes longer than most reconstructions."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path

import jax

MOST_BYTES = 500e6  # of programs in the user's own folder; the oldest go


def keep_programs(folder: str | None, *, off: bool = False) -> None:
    """Let JAX keep programs in ``folder``; by default the one it already uses, or `user_folder`.

    Without a default folder, if it cannot be made or written, programs are just not kept.
    """
    if off:
        jax.config.update("jax_enable_compilation_cache", False)
        return
    # programs of the first steps are small, but many
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    if folder is not None:
        jax.config.update("jax_compilation_cache_dir", folder)
    elif jax.config.jax_compilation_cache_dir is None:  # pyright: ignore[reportAttributeAccessIssue]
        own = user_folder(os.environ, sys.platform)
        try:
            own.mkdir(parents=True, exist_ok=True)
            remove_oldest(own, MOST_BYTES)
        except OSError:
            return
        if os.access(own, os.W_OK | os.X_OK):
            jax.config.update("jax_compilation_cache_dir", str(own))


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
    """Remove the oldest files until the others have at most so many bytes."""
    files = [(path, path.stat()) for path in folder.iterdir() if path.is_file()]
    files.sort(key=lambda item: item[1].st_mtime, reverse=True)
    total = 0
    for path, status in files:
        total += status.st_size
        if total > most_bytes:
            path.unlink(missing_ok=True)
