"""The bases in which step 1 is solved: what each of them must provide for steps 1 to 5."""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
from jaxtyping import Array, Complex, Float

from ..regularization import SolveReport, TikhonovRule


class Basis(eqx.Module):
    """From data to image, in three lines:

    transformed, mass = basis.transform(g)                  # step 2
    fhat, report = basis.fhat(transformed, rule)            # steps 1 and 3
    image = basis.invert(fhat, mass, grid, eta, inversion)  # steps 4 and 5

    A new basis is a class with these three methods.
    """

    name: ClassVar[str]

    @abstractmethod
    def transform(self, g: Float[Array, "images ..."]) -> tuple[Any, Array]:
        """Transformed data of a stack of images, and their total integrals."""

    @abstractmethod
    def fhat(
        self, transformed: Any, rule: TikhonovRule | None
    ) -> tuple[Complex[Array, "images ..."], SolveReport | None]:
        """The Fourier transform of the images on the polar grid, and how it was solved for."""

    @abstractmethod
    def invert(
        self, fhat: Array, mass: Array, grid: Any, eta: Array, inversion: str
    ) -> Float[Array, "images ..."]:
        """The images at the nodes of a grid; eta is the low-pass at all frequencies and at 0."""

    def energies(self, transformed: Any, fhat: Array) -> Float[Array, "2 frequencies"] | None:
        """∫ |fhat|² lambda dtheta at every frequency, up to a factor: from the data, and as it
        came out; None where detectors sample all frequencies, or where it is not known."""
        return None
