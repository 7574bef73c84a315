"""Integrating line detectors: volumes from 2-D problems, one for each angle of rotation."""

from .phantoms import Balls, ProjectedBalls
from .scan import LineDetectorScan
from .volume import invert_projections, reconstruct, reconstruct_stack

__all__ = [
    "Balls",
    "LineDetectorScan",
    "ProjectedBalls",
    "invert_projections",
    "reconstruct",
    "reconstruct_stack",
]
