"""Bessel and Legendre functions for JAX, the full-circle norm built from them, and a root."""

from .bessel import both_kinds as both_kinds
from .bessel import j0 as j0
from .bessel import j1 as j1
from .nufft import from_grid as from_grid
from .nufft import to_grid as to_grid
from .outline_waves import POWER_OF_FACTORS as POWER_OF_FACTORS
from .outline_waves import OutlineNodes as OutlineNodes
from .outline_waves import outline_residual as outline_residual
from .outline_waves import outline_sizes as outline_sizes
from .outline_waves import waves_through_outline as waves_through_outline
from .roots import root as root
from .sequences import decay_steps as decay_steps
from .sequences import enough_orders as enough_orders
from .sequences import full_circle_norm as full_circle_norm
from .sequences import hankel_sequence as hankel_sequence
from .sequences import scaled_hankel_sequence as scaled_hankel_sequence
from .spherical import legendre_functions as legendre_functions
from .spherical import scaled_spherical_sequence as scaled_spherical_sequence
from .spherical import spherical_sequence as spherical_sequence
from .traces_of_waves import angular as angular
from .traces_of_waves import radial_waves as radial_waves
from .traces_of_waves import wave_traces as wave_traces
from .transmission import transmitted_factors as transmitted_factors
