"""Adapters for other packages: their operators, interfaces and image files."""

from .ipasc import IpascAlgorithm
from .labelled_images import save_ome_zarr, to_xarray
from .linear_operators import direct_operator, pylops_operator, scico_operator, scipy_operator
from .patato_files import save_patato

__all__ = [
    "IpascAlgorithm",
    "direct_operator",
    "pylops_operator",
    "save_ome_zarr",
    "save_patato",
    "scico_operator",
    "scipy_operator",
    "to_xarray",
]
