"""Universal back-projection against its sum, taken pixel by pixel."""

import numpy as np

from jaxtat import ImageGrid, circular_arc, phantoms
from jaxtat.steps import universal_back_projection


def test_it_is_the_sum_of_its_formula():
    """At radii that are not equispaced too, from where it interpolates twice."""
    curve, grid = circular_arc(1.3, 1.0, 40), ImageGrid(9)
    bells = phantoms.Bells([[0.1, 0.2], [-0.3, -0.2]], [0.5, 0.4])
    r = np.linspace(0.02, 2.6, 400)
    g = np.asarray(bells.circular_integrals(curve, r))
    image = np.asarray(universal_back_projection(g, r, curve, grid, np.zeros(2)))
    pressure = np.gradient(g / r, r, axis=-1)
    terms = pressure - r * np.gradient(pressure, r, axis=-1)
    wanted = np.zeros(grid.shape)
    pixels, detectors, weights = map(np.asarray, (grid.points, curve.points, curve.weights))
    for place in np.ndindex(*grid.shape):
        total = angles = 0.0
        for z, weight, values in zip(detectors, weights, terms, strict=True):
            offset = pixels[place] - z
            inward = -z / np.linalg.norm(z)
            angle = weight * (offset @ inward) / (offset @ offset)
            total += angle * np.interp(np.linalg.norm(offset), r, values)
            angles += angle
        wanted[place] = total / angles
    assert np.abs(image - wanted).max() < 1e-9 * np.abs(wanted).max()
    bent = 0.02 + 2.58 * np.linspace(0, 1, 1200) ** 1.1
    other = np.asarray(bells.circular_integrals(curve, bent))
    again = np.asarray(universal_back_projection(other, bent, curve, grid, np.zeros(2)))
    assert np.abs(again - wanted).max() < 0.05 * np.abs(wanted).max()
