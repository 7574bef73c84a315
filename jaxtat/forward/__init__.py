"""Integrals over circles and spheres, and their adjoints: fast ones, and by quadrature."""

from .circle_sizes import CircleSizes, circle_sizes
from .circles import default_points, integrate_over_circles, integrate_over_circles_adjoint
from .fast_circles import CircleIntegrals, circle_integrals

__all__ = [
    "CircleIntegrals",
    "CircleSizes",
    "circle_integrals",
    "circle_sizes",
    "default_points",
    "integrate_over_circles",
    "integrate_over_circles_adjoint",
]
