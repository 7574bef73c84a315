"""Three dimensions: detectors on a spherical cap, by the same steps."""

from .back_projection import back_projection
from .caps import DetectorPoints, SphericalCap, spherical_cap
from .phantoms import Balls, Bells
from .pressure import pressure_to_spherical_integrals
from .regions import Ball, ball
from .rings import DetectorRings, find_rings
from .sizes import cap_radii

__all__ = [
    "Ball",
    "Balls",
    "Bells",
    "DetectorPoints",
    "DetectorRings",
    "SphericalCap",
    "back_projection",
    "ball",
    "cap_radii",
    "find_rings",
    "pressure_to_spherical_integrals",
    "spherical_cap",
]
