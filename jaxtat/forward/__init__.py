"""Integrals of images over circles and of volumes over spheres, by non-uniform FFTs."""

from .circular_sizes import CircleSizes, circle_sizes, sizes_inside
from .fast_circles import CircleIntegrals, Positions, circle_integrals, positions_on_circle
from .fast_spheres import SphereIntegrals, pressure_terms, response_factors, sphere_integrals
from .own_responses import OwnResponses
from .spherical_sizes import SphereSizes, sphere_sizes

__all__ = [
    "CircleIntegrals",
    "CircleSizes",
    "OwnResponses",
    "Positions",
    "SphereIntegrals",
    "SphereSizes",
    "circle_integrals",
    "circle_sizes",
    "positions_on_circle",
    "pressure_terms",
    "response_factors",
    "sizes_inside",
    "sphere_integrals",
    "sphere_sizes",
]
