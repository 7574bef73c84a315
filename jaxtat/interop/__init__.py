"""The forward operator in the clothes of other libraries."""

from .linear_operators import pylops_operator, scipy_operator

__all__ = ["pylops_operator", "scipy_operator"]
