"""Three dimensions: detectors on a spherical cap, by the same steps."""

from ..geometry import (
    Ball,
    BallBody,
    DetectorPoints,
    DetectorRings,
    SphericalCap,
    ball,
    find_rings,
    spherical_cap,
)
from ..phantoms.space import Balls, SolidBells
from .classical import back_projection
from .pressure import pressure_to_spherical_integrals
from .sizes import cap_radii

__all__ = [
    "Ball",
    "BallBody",
    "Balls",
    "DetectorPoints",
    "DetectorRings",
    "SolidBells",
    "SphericalCap",
    "back_projection",
    "ball",
    "cap_radii",
    "find_rings",
    "pressure_to_spherical_integrals",
    "spherical_cap",
]
