"""The model of the data: W A f, for images f in C."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..base.precision import in_full
from ..reconstruction import ForwardOperator


class DataFit(eqx.Module):
    """B = W A, from images to data whose noise is white, and where images may differ.

    Attributes:
        operator: A, from images to integrals, or to what was recorded of them.
        whitening: W, 0 for data that are left out, of the shape of one image's data.
        high_pass: H, by which misfits are weighed over radii: ||H (B f - b)||; None for none.
        support: pixels that may differ from zero.
        nonnegative: whether f >= 0.
        white: whether noise has the standard deviation 1 after W.
    """

    operator: ForwardOperator
    whitening: Float[Array, "*data"]
    high_pass: Float[Array, "radii radii"] | None
    support: Bool[Array, "*space"]
    nonnegative: bool = eqx.field(static=True)
    white: bool = eqx.field(static=True)

    def modelled(self, images: Float[Array, "stack *space"]) -> Float[Array, "stack *data"]:
        """B f."""
        return self.operator(jnp.where(self.support, images, 0.0)) * self.whitening

    @in_full
    def transposed(self, data: Float[Array, "stack *data"]) -> Float[Array, "stack *space"]:
        """B^T H^T H d."""
        if self.high_pass is not None:
            data = data @ self.high_pass.T @ self.high_pass
        return jnp.where(self.support, self.operator.T(data * self.whitening), 0.0)

    @in_full
    def misfit(self, data: Float[Array, "stack *data"]) -> Float[Array, ""]:
        """||H d||²."""
        if self.high_pass is not None:
            data = data @ self.high_pass.T
        return jnp.sum(data**2)

    def allowed(self, images: Float[Array, "stack *space"]) -> Float[Array, "stack *space"]:
        """The nearest images in C."""
        if self.nonnegative:
            images = jnp.maximum(images, 0.0)
        return jnp.where(self.support, images, 0.0)

    @property
    def n_data(self) -> Int[Array, ""]:
        """Number of data of one image."""
        return jnp.sum(self.whitening > 0)

    @property
    def n_pixels(self) -> Int[Array, ""]:
        return jnp.sum(self.support)
