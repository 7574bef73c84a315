"""Steps 2 to 5 of the paper: pure functions, one file each."""

from .cartesian_fourier import direct_fourier_inversion
from .classical import classical_fbp
from .fbp import filtered_back_projection
from .polar_fourier import polar_fourier
from .radial_transform import delayed_transform, radial_transform, total_integrals
from .radon import cosine_filter, offset_step, polar_fourier_of_projections, radon_projections

__all__ = [
    "classical_fbp",
    "cosine_filter",
    "delayed_transform",
    "direct_fourier_inversion",
    "filtered_back_projection",
    "offset_step",
    "polar_fourier",
    "polar_fourier_of_projections",
    "radial_transform",
    "radon_projections",
    "total_integrals",
]
