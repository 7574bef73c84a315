"""What a person wants to know of a reconstruction: what can be seen, how well, and how surely."""

from .diagnosis import (
    UNCERTAINTY_PIXELS,
    Diagnosis,
    Uncertainty,
    WaveAccuracy,
    diagnose,
    plan_of,
    wave_accuracy,
)
from .residual import DataResidual, data_residual

__all__ = [
    "UNCERTAINTY_PIXELS",
    "DataResidual",
    "Diagnosis",
    "Uncertainty",
    "WaveAccuracy",
    "data_residual",
    "diagnose",
    "plan_of",
    "wave_accuracy",
]
