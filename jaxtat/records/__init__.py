"""From pressure records to circular integrals: conditioning, noise, channels, sampling."""

from .channels import ChannelQuality, channel_quality, ranges
from .image_records import simulate_pressure
from .impulse_response import (
    apply_impulse_response,
    gaussian_response,
    remove_impulse_response,
)
from .noise import LEAST_SAMPLES, RecordNoise, noise_of_record, record_noise_level
from .pressure import MODELS, condition_record, pressure_to_circular_integrals, require_equispaced
from .pressure_simulation import circular_integrals_to_pressure, pressure_matrix
from .sampling import Supported, first_arrival, sampled_frequency, supported
from .water import water_speed

__all__ = [
    "LEAST_SAMPLES",
    "MODELS",
    "ChannelQuality",
    "RecordNoise",
    "Supported",
    "apply_impulse_response",
    "channel_quality",
    "circular_integrals_to_pressure",
    "condition_record",
    "first_arrival",
    "gaussian_response",
    "noise_of_record",
    "pressure_matrix",
    "pressure_to_circular_integrals",
    "ranges",
    "record_noise_level",
    "remove_impulse_response",
    "require_equispaced",
    "sampled_frequency",
    "simulate_pressure",
    "supported",
    "water_speed",
]
