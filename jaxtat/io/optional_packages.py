"""Packages that only some files need."""

import importlib
from typing import Any


def optional(module: str, purpose: str) -> Any:
    """The module, or ValueError saying how to install it.

    Args:
        module: its name, of a package in the extra ``io``.
        purpose: what needs it, for the message.

    >>> optional("json", "this example").loads("[1]")
    [1]
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ValueError(
            f"{purpose} needs {module} ({error}): pip install 'jaxtat[io]'."
        ) from error
