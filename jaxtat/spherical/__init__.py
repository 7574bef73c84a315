"""Three dimensions: detectors on a spherical cap, by the same steps."""

from .alpha import SeenOnce
from .back_projection import back_projection
from .caps import DetectorPoints, SphericalCap, spherical_cap
from .forward import spherical_integrals, spherical_integrals_adjoint
from .layout import CapLayout, cap_layout, cap_radii
from .phantoms import Balls, Bells
from .pressure import pressure_to_spherical_integrals
from .reconstruction import CapReconstruction, reconstruct_cap
from .regions import BallPart, ball_part, enough_boundary
from .rings import DetectorRings, find_rings

__all__ = [
    "BallPart",
    "Balls",
    "Bells",
    "CapLayout",
    "CapReconstruction",
    "DetectorPoints",
    "DetectorRings",
    "SeenOnce",
    "SphericalCap",
    "back_projection",
    "ball_part",
    "cap_layout",
    "cap_radii",
    "enough_boundary",
    "find_rings",
    "pressure_to_spherical_integrals",
    "reconstruct_cap",
    "spherical_cap",
    "spherical_integrals",
    "spherical_integrals_adjoint",
]
