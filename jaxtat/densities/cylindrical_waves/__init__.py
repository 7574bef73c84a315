"""Cylindrical waves: step 1 without collocation, and reconstruction without step 1."""

from .consistency import (
    Waves,
    cross_validation,
    unexplained,
    unexplained_share,
    waves_of,
)
from .densities import (
    CylindricalDensities,
    DensityGroup,
    alpha_units,
    cylindrical_densities,
    group_of,
    sampled_cylindrical_densities,
    unfold,
    wave_system,
)
from .kernels import BodyKernels, HankelKernels, Kernels, OutlineKernels
from .orders import frequency_groups
from .polar import (
    PolarGeometry,
    polar_geometry,
    require_resolved,
    wave_offset,
    wave_orders,
    waves_reach,
)
from .table import WaveTable, wave_table
from .tikhonov import RuleInputs, solve_cylindrical_waves
from .tikhonov_rows import DecomposedWaves, decomposed_waves, tikhonov_densities
from .waves import circular_harmonics_at

__all__ = [
    "BodyKernels",
    "CylindricalDensities",
    "DecomposedWaves",
    "DensityGroup",
    "HankelKernels",
    "Kernels",
    "OutlineKernels",
    "PolarGeometry",
    "RuleInputs",
    "WaveTable",
    "Waves",
    "alpha_units",
    "circular_harmonics_at",
    "cross_validation",
    "cylindrical_densities",
    "decomposed_waves",
    "frequency_groups",
    "group_of",
    "polar_geometry",
    "require_resolved",
    "sampled_cylindrical_densities",
    "solve_cylindrical_waves",
    "tikhonov_densities",
    "unexplained",
    "unexplained_share",
    "unfold",
    "wave_offset",
    "wave_orders",
    "wave_system",
    "wave_table",
    "waves_of",
    "waves_reach",
]
