"""From image to data, and the exact transpose."""

from jaxtyping import Array, Float

from ..base.checks import Numbers
from .operator import forward_operator
from .setup import Setup, require_setup

METHODS = ("fast", "quadrature")


def circular_integrals(
    setup: Setup, image: Numbers, *, method: str = "fast"
) -> Float[Array, "..."]:
    """g(z, r) = ∫_{|x - z| = r} f of a pixel image over circles, or of a volume over spheres.

    By `forward_operator` (use that for many images) or by quadrature. Between its pixels the image
    is band-limited; for the quadrature it is interpolated by Keys' cubic polynomials, and is zero
    outside the grid. It is not cut off at the region. Linear in the image;
    differentiable in the image, the detector positions and the radii.

    Args:
        setup: detectors, grid and radii.
        image: f at the nodes of the grid, (..., x1, x2) or (..., x1, x2, x3).
        method: "fast" or "quadrature", the reference: third order in the pixel, and slow.

    Returns:
        (..., *setup.data_shape) [length times the unit of f; in space length²].

    Raises:
        ValueError: for an image that does not fit the grid, NaN in it, or an unknown method.

    Source: Keys, IEEE Trans. ASSP 29 (1981) 1153-1160 (interpolation).

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(33), max_frequency=30.0)
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.6])
    >>> g = circular_integrals(setup, bell.image(setup.grid))
    >>> bool(abs(g - bell.circular_integrals(setup.curve, setup.radii)).max() < 1e-4)
    True
    """
    if _by_quadrature(setup, method):
        where = setup.grid, setup.curve, setup.radii
        return setup.kind.integrals(image, *where, n_points=setup.sizes.n_quadrature)
    return forward_operator(setup)(image)


def circular_integrals_adjoint(
    setup: Setup, data: Numbers, *, method: str = "fast"
) -> Float[Array, "..."]:
    """The exact transpose of `circular_integrals`: Σ g·data = Σ image·adjoint(data).

    Args:
        setup, method: as in `circular_integrals`.
        data: (..., *setup.data_shape).

    Returns:
        (..., *setup.grid.shape).

    Raises:
        ValueError: for data of another shape, NaN in them, or an unknown method.

    >>> import jax.numpy as jnp
    >>> from jaxtat import ImageGrid, circular_arc, disk
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> circular_integrals_adjoint(setup, jnp.ones(setup.data_shape)).shape
    (21, 21)
    """
    if _by_quadrature(setup, method):
        where = setup.grid, setup.curve, setup.radii
        return setup.kind.adjoint(data, *where, n_points=setup.sizes.n_quadrature)
    return forward_operator(setup).T(data)


def circular_means(setup: Setup, image: Numbers) -> Float[Array, "..."]:
    """Means of a pixel image over circles, g(z, r)/2πr, or of a volume over spheres, g/4πr².

    Args:
        setup, image: as in `circular_integrals`.

    Returns:
        (..., *setup.data_shape), in the unit of f.

    Raises:
        ValueError: as `circular_integrals`.

    >>> import jax.numpy as jnp
    >>> from jaxtat import ImageGrid, circular_arc, disk
    >>> setup = Setup(circular_arc(1.3, 1.0, 80), disk(1.0), ImageGrid(21))
    >>> circular_means(setup, jnp.ones(setup.grid.shape)).shape == setup.data_shape
    True
    """
    require_setup(setup)
    return circular_integrals(setup, image) / setup.kind.measure(setup.radii)


def _by_quadrature(setup: Setup, method: str) -> bool:
    require_setup(setup)
    if method not in METHODS:
        raise ValueError(f"method is {method!r}, expected one of {', '.join(METHODS)}.")
    return method == "quadrature"
