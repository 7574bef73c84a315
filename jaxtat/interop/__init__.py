"""jaxtat in the pipelines of others: its operator in their clothes, its images in their files."""

from .linear_operators import pylops_operator, scipy_operator
from .patato_files import save_patato

__all__ = ["pylops_operator", "save_patato", "scipy_operator"]
