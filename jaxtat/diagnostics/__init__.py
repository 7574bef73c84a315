"""What a person wants to know of a reconstruction: what can be seen, how well, and how surely."""

from .data_noise import DataNoise, NoiseSource, noise_of_residual
from .diagnosis import (
    UNCERTAINTY_PIXELS,
    Diagnosis,
    Uncertainty,
    WaveAccuracy,
    affordable_pixels,
    diagnose,
    plan_of_direct,
    wave_accuracy,
)
from .residual import DataResidual, data_residual

__all__ = [
    "UNCERTAINTY_PIXELS",
    "DataNoise",
    "DataResidual",
    "Diagnosis",
    "NoiseSource",
    "Uncertainty",
    "WaveAccuracy",
    "affordable_pixels",
    "data_residual",
    "diagnose",
    "noise_of_residual",
    "plan_of_direct",
    "wave_accuracy",
]
