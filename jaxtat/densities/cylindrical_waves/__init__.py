"""Cylindrical waves: step 1 without collocation, and reconstruction without step 1."""

from .consistency import (
    Waves,
    cross_validation,
    unexplained,
    unexplained_share,
    waves_of,
)
from .densities import (
    DensityGroup,
    HarmonicDensities,
    alpha_units,
    group_of,
    harmonic_densities,
    sampled_harmonic_densities,
    unfold,
    wave_system,
)
from .kernels import BodyKernels, HankelKernels, Kernels
from .orders import frequency_groups
from .polar import PolarGeometry, harmonic_orders, polar_geometry, wave_offset, waves_reach
from .table import WaveTable, wave_table
from .tikhonov import RuleInputs, solve_harmonics
from .tikhonov_rows import DecomposedWaves, decomposed_waves, tikhonov_densities
from .waves import circular_harmonics_at

__all__ = [
    "BodyKernels",
    "DecomposedWaves",
    "DensityGroup",
    "HankelKernels",
    "HarmonicDensities",
    "Kernels",
    "PolarGeometry",
    "RuleInputs",
    "WaveTable",
    "Waves",
    "alpha_units",
    "circular_harmonics_at",
    "cross_validation",
    "decomposed_waves",
    "frequency_groups",
    "group_of",
    "harmonic_densities",
    "harmonic_orders",
    "polar_geometry",
    "sampled_harmonic_densities",
    "solve_harmonics",
    "tikhonov_densities",
    "unexplained",
    "unexplained_share",
    "unfold",
    "wave_offset",
    "wave_system",
    "wave_table",
    "waves_of",
    "waves_reach",
]
