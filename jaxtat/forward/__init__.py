"""Integrals over circles and spheres, and their adjoints: fast ones, and by quadrature."""

from .circles import default_points, integrate_over_circles, integrate_over_circles_adjoint
from .circular_sizes import CircleSizes, circle_sizes
from .fast_circles import CircleIntegrals, circle_integrals
from .fast_spheres import SphereIntegrals, sphere_integrals
from .spherical_sizes import SphereSizes, sphere_sizes

__all__ = [
    "CircleIntegrals",
    "CircleSizes",
    "SphereIntegrals",
    "SphereSizes",
    "circle_integrals",
    "circle_sizes",
    "default_points",
    "integrate_over_circles",
    "integrate_over_circles_adjoint",
    "sphere_integrals",
    "sphere_sizes",
]
