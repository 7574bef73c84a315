"""Conjugate gradients whose stopping rule is relative to the norm of the right-hand side."""

from typing import Any

import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array

from ..special import root


class RelativeCG(lx.AbstractLinearSolver):
    """Conjugate gradients that stop when the norm of the residual is small relative to b.

    The relative tolerance of `lineax.CG` is elementwise, and pixels that are zero meet it last. Its
    absolute one would accept small derivatives before the first step.

    Source: Hestenes and Stiefel, J. Res. Nat. Bur. Standards 49 (1952) 409-436.
    """

    tolerance: Array | float
    max_steps: Array | int

    @property
    def solver(self) -> lx.CG:
        return lx.CG(
            rtol=0.0,
            atol=self.tolerance,  # pyright: ignore[reportArgumentType]
            norm=lx.internal.two_norm,
            stabilise_every=None,
            max_steps=self.max_steps,  # pyright: ignore[reportArgumentType]
        )

    def init(self, operator: lx.AbstractLinearOperator, options: dict[str, Any]) -> Any:
        return self.solver.init(operator, options)

    def compute(self, state: Any, vector: Array, options: dict[str, Any]) -> Any:
        norm = root(jnp.sum(vector**2))
        size = jnp.where(norm > 0, norm, 1.0)
        value, result, stats = self.solver.compute(state, vector / size, options)
        return size * value, result, stats

    def transpose(self, state: Any, options: dict[str, Any]) -> Any:
        return self.solver.transpose(state, options)

    def conj(self, state: Any, options: dict[str, Any]) -> Any:
        return self.solver.conj(state, options)

    def assume_full_rank(self) -> bool:
        return True
