"""Questions about a reconstruction: accuracy, uncertainty, noise, calibration."""

from .calibration import Calibration, calibrate
from .comparison import compare_regularizations
from .data_noise import DataNoise, NoiseSource, noise_of_residual
from .diagnosis import (
    UNCERTAINTY_PIXELS,
    Diagnosis,
    Uncertainty,
    WaveAccuracy,
    affordable_pixels,
    diagnose,
    plan_of,
    wave_accuracy,
)
from .element_positions import ElementPositions, calibrate_positions
from .expected_errors import expected_error, image_power
from .image_sharpness import sharpness
from .noise_law import predict_noise
from .residual import DataResidual, data_residual
from .uncertainty import pixel_standard_deviation

__all__ = [
    "UNCERTAINTY_PIXELS",
    "Calibration",
    "DataNoise",
    "DataResidual",
    "Diagnosis",
    "ElementPositions",
    "NoiseSource",
    "Uncertainty",
    "WaveAccuracy",
    "affordable_pixels",
    "calibrate",
    "calibrate_positions",
    "compare_regularizations",
    "data_residual",
    "diagnose",
    "expected_error",
    "image_power",
    "noise_of_residual",
    "pixel_standard_deviation",
    "plan_of",
    "predict_noise",
    "sharpness",
    "wave_accuracy",
]
