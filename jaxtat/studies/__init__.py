"""Questions about a reconstruction: accuracy, uncertainty, noise, calibration."""

from .autofocus import sharpness, sound_speed_by_sharpness
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
from .noise_choice import NoiseChoice, choose_regularization, image_power
from .noise_law import predict_noise
from .residual import DataResidual, data_residual
from .seen_edges import visibility_map
from .uncertainty import pixel_standard_deviation

__all__ = [
    "UNCERTAINTY_PIXELS",
    "Calibration",
    "DataNoise",
    "DataResidual",
    "Diagnosis",
    "NoiseChoice",
    "NoiseSource",
    "Uncertainty",
    "WaveAccuracy",
    "affordable_pixels",
    "calibrate",
    "choose_regularization",
    "compare_regularizations",
    "data_residual",
    "diagnose",
    "image_power",
    "noise_of_residual",
    "pixel_standard_deviation",
    "plan_of",
    "predict_noise",
    "sharpness",
    "sound_speed_by_sharpness",
    "visibility_map",
    "wave_accuracy",
]
