"""Integrating line detectors: volumes from 2-D problems, one for each angle of rotation."""

from .phantoms import PolynomialBalls, ProjectedBalls
from .scan import LineDetectorScan
from .volume import invert_projections, reconstruct, reconstruct_stack

__all__ = [
    "LineDetectorScan",
    "PolynomialBalls",
    "ProjectedBalls",
    "invert_projections",
    "reconstruct",
    "reconstruct_stack",
]
