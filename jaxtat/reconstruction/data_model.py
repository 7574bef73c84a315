"""The other way round: the data of an image, and the adjoint."""

from jaxtyping import Array, Float

from ..base.checks import Numbers
from .setup import Setup, require_setup


def circular_integrals(setup: Setup, image: Numbers) -> Float[Array, "..."]:
    """g(z, r) = ∫_{|x - z| = r} f of a pixel image over circles, or of a volume over spheres.

    The image is continued between its pixels by Keys' cubic interpolation and by zero outside the
    grid; nothing is cut off at the region. Linear in the image; differentiable in the image, the
    detector positions and the radii. Memory stays at a few detectors' worth, in reverse mode too.

    Args:
        setup: detectors, grid and radii.
        image: f at the nodes of the grid, (..., x1, x2) or (..., x1, x2, x3).

    Returns:
        (..., *setup.data_shape) [length times the unit of f; in space length²].

    Raises:
        ValueError: for an image that does not fit the grid, or NaN in it.

    Source: Keys, IEEE Trans. ASSP 29 (1981) 1153-1160 (interpolation).

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 12), disk(1.0), ImageGrid(65), max_frequency=10.0)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.6])
    >>> g = circular_integrals(setup, bell.image(setup.grid))
    >>> bool(abs(g - bell.circular_integrals(setup.curve, setup.radii)).max() < 1e-3)
    True
    """
    require_setup(setup)
    where = setup.grid, setup.curve, setup.radii
    return setup.kind.integrals(image, *where, n_points=setup.sizes.n_quadrature)


def circular_integrals_adjoint(setup: Setup, data: Numbers) -> Float[Array, "..."]:
    """The exact transpose of `circular_integrals`: Σ g·data = Σ image·adjoint(data).

    Args:
        setup: detectors, grid and radii.
        data: (..., *setup.data_shape).

    Returns:
        (..., *setup.grid.shape).
    """
    require_setup(setup)
    where = setup.grid, setup.curve, setup.radii
    return setup.kind.adjoint(data, *where, n_points=setup.sizes.n_quadrature)


def circular_means(setup: Setup, image: Numbers) -> Float[Array, "..."]:
    """Means of a pixel image over circles, g(z, r)/2πr, or of a volume over spheres, g/4πr²."""
    require_setup(setup)
    return circular_integrals(setup, image) / setup.kind.measure(setup.radii)
