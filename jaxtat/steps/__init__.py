"""Steps 2 to 5 of the paper: functions of arrays, one file each."""

from .classical import classical_fbp
from .fbp import filtered_back_projection
from .fourier_sum import fourier_inversion
from .polar_transform import polar_fourier
from .quadrature import trapezoid_weights
from .radial_transforms import delayed_transform, radial_transform, total_integrals
from .radon import cosine_filter, offset_step, polar_fourier_of_projections, radon_projections
from .resolution import (
    UNSAMPLED,
    AccuracyWarning,
    Contradiction,
    TooFewDetectors,
    UnreachedWaves,
    enough_boundary,
    polar_grid,
    require_boundary,
    require_pixels,
    require_problem,
    warn_of_detectors,
)
from .universal import universal_back_projection

__all__ = [
    "UNSAMPLED",
    "AccuracyWarning",
    "Contradiction",
    "TooFewDetectors",
    "UnreachedWaves",
    "classical_fbp",
    "cosine_filter",
    "delayed_transform",
    "enough_boundary",
    "filtered_back_projection",
    "fourier_inversion",
    "offset_step",
    "polar_fourier",
    "polar_fourier_of_projections",
    "polar_grid",
    "radial_transform",
    "radon_projections",
    "require_boundary",
    "require_pixels",
    "require_problem",
    "total_integrals",
    "trapezoid_weights",
    "universal_back_projection",
    "warn_of_detectors",
]
