"""Packages that only some files need."""

import importlib
from typing import Any


def optional(module: str, purpose: str, extra: str = "io") -> Any:
    """The module, or ValueError saying how to install it.

    Args:
        module: its name.
        purpose: what needs it, for the message.
        extra: of jaxtat, which installs it.

    >>> optional("json", "this example").loads("[1]")
    [1]
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ValueError(
            f"{purpose} needs {module} ({error}): pip install 'jaxtat[{extra}]'."
        ) from error
