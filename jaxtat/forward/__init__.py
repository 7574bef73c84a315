"""Integrals of images over circles and of volumes over spheres, by non-uniform FFTs."""

from .circular_sizes import CircleSizes, circle_sizes, sizes_inside
from .fast_circles import CircleIntegrals, circle_integrals
from .fast_spheres import SphereIntegrals, pressure_terms, response_factors, sphere_integrals
from .own_responses import OwnResponses
from .spherical_sizes import SphereSizes, sphere_sizes

__all__ = [
    "CircleIntegrals",
    "CircleSizes",
    "OwnResponses",
    "SphereIntegrals",
    "SphereSizes",
    "circle_integrals",
    "circle_sizes",
    "pressure_terms",
    "response_factors",
    "sizes_inside",
    "sphere_integrals",
    "sphere_sizes",
]
