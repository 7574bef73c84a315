"""Images whose integrals are known in closed form, and noise; those in space: `phantoms.space`."""

from .plane import Bells, Disks, Phantom, noise_like
from .radial import RadialParts, gauss_legendre

__all__ = ["Bells", "Disks", "Phantom", "RadialParts", "gauss_legendre", "noise_like"]
