"""Steps 1 to 5 in a row: from circular integrals to the image, whatever the basis."""

from jaxtyping import Array, Float

from ..densities import Basis
from ..geometry import Grid
from ..regularization import SolveReport, TikhonovRule


def images_of(
    basis: Basis,
    g: Float[Array, "images ..."],
    grid: Grid,
    rule: TikhonovRule | None,
    eta: Float[Array, " all_frequencies"],
    inversion: str,
) -> tuple[Float[Array, "images ..."], SolveReport | None, Array | None]:
    """The images of a stack of data, how they were solved for, and `Basis.energies`."""
    transformed, mass = basis.transform(g)  # step 2
    fhat, report = basis.fhat(transformed, rule)  # steps 1 and 3
    images = basis.invert(fhat, mass, grid, eta, inversion)  # steps 4 and 5
    return images, report, basis.energies(transformed, fhat)
