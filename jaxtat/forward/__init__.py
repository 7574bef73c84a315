"""Integrals over circles and spheres, and their adjoints, by quadrature: the reference."""

from .circles import default_points, integrate_over_circles, integrate_over_circles_adjoint

__all__ = ["default_points", "integrate_over_circles", "integrate_over_circles_adjoint"]
