"""The command ``jaxtat``."""

from .main import main

__all__ = ["main"]
