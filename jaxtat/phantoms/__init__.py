"""Phantoms: images with exact integrals, and noise. Those in space are in `phantoms.space`."""

from .plane import Bells, Disks, Phantom, noise_like
from .radial import RadialParts, gauss_legendre

__all__ = ["Bells", "Disks", "Phantom", "RadialParts", "gauss_legendre", "noise_like"]
