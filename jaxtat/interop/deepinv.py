"""jaxtat as a linear physics of DeepInverse: for its denoisers, unfolded networks and losses.

Needs DeepInverse and PyTorch: ``pip install 'jaxtat[deepinv]'``. Arrays go from one library to the
other by DLPack, without a copy where both are on the same device.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array

from ..base.checks import require_x64
from ..base.optional_packages import optional
from ..fitting.relative_cg import RelativeCG
from ..reconstruction import ForwardOperator, Setup, forward_operator, reconstruct

torch: Any = optional("torch", "jaxtat.interop.deepinv", "deepinv")
physics: Any = optional("deepinv.physics", "jaxtat.interop.deepinv", "deepinv")

PROX_TOLERANCE, PROX_STEPS = 1e-8, 500


class TomographyPhysics(physics.LinearPhysics):
    """y = A x, from images (batch, 1, x1, x2) to integrals (batch, 1, detectors, radii).

    A is `forward_operator(setup)`; its adjoint is exact. Gradients go through all four maps, those
    of the first three to any order.

    Args:
        setup: detectors, region, grid and radii, in the plane.
        rule: of `A_dagger`, as in `solve`.
        dtype: of the computation: `torch.float64` or `torch.float32`, whatever the tensors are.
        kwargs: of `deepinv.physics.LinearPhysics`, such as ``noise_model``.

    Raises:
        ValueError: as `forward_operator`.
    """

    def __init__(
        self, setup: Setup, rule: Any = None, *, dtype: Any = torch.float64, **kwargs: Any
    ) -> None:
        require_x64()
        super().__init__(img_size=(1, *setup.grid.shape), **kwargs)
        single = dtype == torch.float32
        self.operator = forward_operator(setup, dtype=jnp.float32 if single else None)
        self.setup, self.rule, self._dtype = setup, rule, dtype
        self._shapes = setup.grid.shape, setup.data_shape

    def A(self, x: Any, **kwargs: Any) -> Any:
        """A x."""
        return self._mapped(x, self.operator, self.operator.T)

    def A_adjoint(self, y: Any, **kwargs: Any) -> Any:
        """A^T y, exactly."""
        return self._mapped(y, self.operator.T, self.operator)

    def A_dagger(self, y: Any, **kwargs: Any) -> Any:
        """The direct reconstruction: `reconstruct(setup, y, rule)`, in closed form.

        It is a regularised inverse of A on images that vanish outside the region, there only, and
        of detail that the detectors see; it is no Moore-Penrose inverse: A A_dagger A is A but for
        that error. The image is zero outside the region.
        """
        return self._mapped(y, self._direct, self._direct_transposed)

    def prox_l2(self, z: Any, y: Any, gamma: Any, **kwargs: Any) -> Any:
        """argmin_x gamma ||A x - y||²/2 + ||x - z||²/2 = (I + gamma A^T A)^-1 (z + gamma A^T y).

        By conjugate gradients to 1e-8, compiled: the direct solve is regularised in the densities,
        not in the pixels, and is not this map. Gradients in z, y and gamma are implicit.
        """
        y = y.to(self._dtype)
        if z is None or isinstance(z, int | float):
            z = torch.full_like(self.A_adjoint(y), float(z or 0.0))
        gamma = torch.as_tensor(gamma, dtype=torch.float64)
        if gamma.numel() != 1:
            raise ValueError(f"gamma has shape {tuple(gamma.shape)}, expected one number.")
        return _Prox.apply(z, y, gamma.reshape(()), self.operator)

    def _mapped(self, values: Any, there: Callable, back: Callable) -> Any:
        return _Linear.apply(values, there, back, self.operator.dtype)

    def _direct(self, data: Array) -> Array:
        stack = data.astype(jnp.float64).reshape(-1, *self._shapes[1])
        images = reconstruct(self.setup, stack, self.rule)
        inside = self.setup.region.contains(self.setup.grid.points)
        images = jnp.where(inside, images, 0.0).astype(data.dtype)
        return images.reshape(*data.shape[: data.ndim - 2], *self._shapes[0])

    def _direct_transposed(self, images: Array) -> Array:
        batch = images.shape[: images.ndim - 2]
        _, transposed = jax.vjp(self._direct, jnp.zeros((*batch, *self._shapes[1]), images.dtype))
        return transposed(images)[0]


def to_jax(tensor: Any, dtype: Any = None) -> Array:
    """A tensor as an array of JAX."""
    array = jax.dlpack.from_dlpack(tensor.detach().contiguous())
    return array if dtype is None else array.astype(dtype)


def to_torch(array: Array, like: Any) -> Any:
    """An array of JAX as a tensor, in the precision of another tensor."""
    return torch.from_dlpack(array.block_until_ready()).to(like.dtype)


class _Linear(torch.autograd.Function):
    """A linear map and its transpose: each is the other's derivative."""

    @staticmethod
    def forward(ctx: Any, values: Any, there: Callable, back: Callable, dtype: Any) -> Any:
        ctx.maps = there, back, dtype
        return to_torch(there(to_jax(values, dtype)), values)

    @staticmethod
    def backward(ctx: Any, *slopes: Any) -> tuple[Any, None, None, None]:
        there, back, dtype = ctx.maps
        return _Linear.apply(slopes[0], back, there, dtype), None, None, None


class _Prox(torch.autograd.Function):
    """x = S (z + gamma A^T y) with S = (I + gamma A^T A)^-1, which is symmetric.

    So for a slope s and w = S s: ds/dz = w, ds/dy = gamma A w, and since
    dx/dgamma = S A^T (y - A x), ds/dgamma = (A w)·(y - A x).
    """

    @staticmethod
    def forward(ctx: Any, z: Any, y: Any, gamma: Any, operator: ForwardOperator) -> Any:
        ctx.operator = operator
        right = to_jax(z, operator.dtype)
        weight = to_jax(gamma, operator.dtype)
        right = right + weight * operator.T(to_jax(y, operator.dtype))
        x = to_torch(_solved(operator, right, weight), z)
        ctx.save_for_backward(x, y, gamma)
        return x

    @staticmethod
    def backward(ctx: Any, *slopes: Any) -> tuple[Any, Any, Any, None]:
        x, y, gamma = ctx.saved_tensors
        operator, (slope,) = ctx.operator, slopes
        weight = to_jax(gamma, operator.dtype)
        w = _solved(operator, to_jax(slope, operator.dtype), weight)
        seen = operator(w)
        left = to_jax(y, operator.dtype) - operator(to_jax(x, operator.dtype))
        of_gamma = jnp.vdot(seen, left).astype(jnp.float64)
        return to_torch(w, slope), to_torch(weight * seen, y), to_torch(of_gamma, gamma), None


@eqx.filter_jit
def _solved(operator: ForwardOperator, right: Array, gamma: Array) -> Array:
    """(I + gamma A^T A) x = right for each image, by conjugate gradients."""

    def of_one(right: Array) -> Array:
        def normal(image: Array) -> Array:
            return image + gamma * operator.T.mv(operator.mv(image))

        matrix = lx.FunctionLinearOperator(
            normal, jax.ShapeDtypeStruct(right.shape, right.dtype), lx.positive_semidefinite_tag
        )
        tolerance = jnp.asarray(PROX_TOLERANCE if right.dtype == jnp.float64 else 1e-5, right.dtype)
        solver = RelativeCG(tolerance, jnp.asarray(PROX_STEPS))
        return lx.linear_solve(matrix, right, solver, throw=False).value

    return jax.lax.map(of_one, right.reshape(-1, *right.shape[-2:])).reshape(right.shape)
