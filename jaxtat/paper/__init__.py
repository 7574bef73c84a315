"""The numerical section of Kunyansky's 2008 paper, run anew: ``jaxtat paper``."""

from .run import run_paper

__all__ = ["run_paper"]
