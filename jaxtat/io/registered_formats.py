"""Formats of scans that other packages register: entry points of the group `jaxtat.scan_formats`.

An entry point is a module, or any object, with two functions: ``recognise(path) -> bool`` and
``read(path) -> Scan``.
"""

from collections.abc import Callable
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from .limits import refusing
from .scan import Kind, Scan

GROUP = "jaxtat.scan_formats"


def registered_reader(path: Path) -> Callable[[Kind | None], Scan] | None:
    """How to read a file of a registered format; None if no such format recognises it.

    Raises:
        ValueError: for an entry point that fails, which is named with its package.
    """
    for entry in entry_points(group=GROUP):
        with refusing(f"{_named(entry)}: ", "it failed", "; uninstall it, or tell its authors."):
            form = entry.load()
            recognised = form.recognise(path)
        if recognised:
            return partial(_read, entry, form, path)
    return None


# an entry is of importlib_metadata, not of Python, once some other package has imported that
def _named(entry: Any) -> str:
    package = entry.dist.name if entry.dist else "an unknown package"
    return f"the format {entry.name!r} of {package}"


def _read(entry: Any, form: Any, path: Path, kind: Kind | None) -> Scan:
    with refusing(f"{_named(entry)}: "):
        scan = form.read(path)
        if not isinstance(scan, Scan):
            raise ValueError(f"it returned a {type(scan).__name__}, expected a jaxtat.io.Scan")
        if kind not in (None, scan.kind):
            raise ValueError(f"it holds {scan.kind}, and {kind} was wanted")
    return scan
