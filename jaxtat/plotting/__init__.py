"""Figures: images, volumes, geometries, the frequency plane, data; axes have units.

Every function draws on given axes; figures need no screen and no global state. Colour maps are
readable without colour vision: grey, viridis, and blue to red through white.
"""

from .canvas import (
    DIVERGING,
    GRAY,
    SEQUENTIAL,
    gray_levels,
    greatest,
    label_axes,
    length_label,
    new_figure,
)
from .data import show_detectors, show_sinogram
from .frequencies import show_frequencies, show_frequency_plane
from .geometry import show_edges, show_geometry, show_opening, show_visibility
from .images import add_scale_bar, contact_sheet, picture, save_picture, show_image
from .volumes import save_volume, show_projections, show_slices, show_space

__all__ = [
    "DIVERGING",
    "GRAY",
    "SEQUENTIAL",
    "add_scale_bar",
    "contact_sheet",
    "gray_levels",
    "greatest",
    "label_axes",
    "length_label",
    "new_figure",
    "picture",
    "save_picture",
    "save_volume",
    "show_detectors",
    "show_edges",
    "show_frequencies",
    "show_frequency_plane",
    "show_geometry",
    "show_image",
    "show_opening",
    "show_projections",
    "show_sinogram",
    "show_slices",
    "show_space",
    "show_visibility",
]
