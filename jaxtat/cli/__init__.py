"""The command ``jaxtat``."""

from .entry import main

__all__ = ["main"]
