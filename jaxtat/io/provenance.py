"""Provenance of a result: its settings, input files and versions."""

import hashlib
import json
import math
import platform
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..version import __version__


def as_json(name: str, value: Any) -> str:
    """``value`` as JSON that gives it back to the last bit; arrays become lists, paths text.

    Raises:
        ValueError: for what JSON cannot hold, with its name.

    >>> as_json("settings", {"alpha": np.float64(0.1), "use": (0, 3)})
    '{"alpha": 0.1, "use": [0, 3]}'
    """
    return json.dumps(_plain(name, value), allow_nan=False, ensure_ascii=False)


def _plain(name: str, value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray | jax.Array):
        value = np.asarray(value).tolist()
    if isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            raise ValueError(f"{name} has keys {list(value)}, expected names.")
        return {key: _plain(f"{name}[{key!r}]", item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(f"{name}[{i}]", item) for i, item in enumerate(value)]
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float) and math.isfinite(value):
        return value
    raise ValueError(
        f"{name} is {value!r}, which cannot be stored: expected finite real numbers, text, True, "
        "False, None, or lists and dicts of them."
    )


def provenance_of(inputs: Iterable[str | Path], unit: str | None) -> dict[str, Any]:
    """Date, versions, kind of device, unit of length, name and SHA-256 of every input file."""
    packages = {name: version(name) for name in ("jax", "jaxlib", "numpy")}
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {"jaxtat": __version__, **packages, "python": platform.python_version()},
        "platform": jax.default_backend(),
        "length_unit": unit,
        "inputs": [{"name": Path(path).name, "sha256": sha256(path)} for path in inputs],
    }


def sha256(path: str | Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
