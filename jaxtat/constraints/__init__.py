"""Images with constraints: what data leave open, a penalty decides."""

from .fit import ModelBased, model_based
from .penalties import (
    NoPenalty,
    Penalty,
    Ridge,
    SecondOrderVariation,
    TotalVariation,
    Wavelets,
)

__all__ = [
    "ModelBased",
    "NoPenalty",
    "Penalty",
    "Ridge",
    "SecondOrderVariation",
    "TotalVariation",
    "Wavelets",
    "model_based",
]
