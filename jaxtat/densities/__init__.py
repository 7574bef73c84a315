"""Step 1: densities on the curve whose potentials are plane waves in the region."""

from .basis import Basis
from .boundary import solve_on_boundary
from .collocation import collocation_densities, series_densities
from .single_layer import phases_from, plane_wave, potential
from .stored import Densities, DensityReport, SampledDensities, in_precision
from .symmetry import find_mirror

__all__ = [
    "Basis",
    "Densities",
    "DensityReport",
    "SampledDensities",
    "collocation_densities",
    "find_mirror",
    "in_precision",
    "phases_from",
    "plane_wave",
    "potential",
    "series_densities",
    "solve_on_boundary",
]
