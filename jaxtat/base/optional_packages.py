"""Packages that only some files need."""

import importlib
from typing import Any


def optional(module: str, purpose: str, extra: str = "io") -> Any:
    """The module, or ValueError saying how to install it.

    Args:
        module: its name.
        purpose: what needs it, for the message.
        extra: of jaxtat, which installs it, or the whole command where none can.

    >>> optional("json", "this example").loads("[1]")
    [1]
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        command = extra if extra.startswith("pip ") else f"pip install 'jaxtat[{extra}]'"
        raise ValueError(f"{purpose} needs {module} ({error}): {command}.") from error
