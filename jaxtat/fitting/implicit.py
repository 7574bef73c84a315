"""Derivatives of a minimiser by the implicit function theorem, without its iterations.

Where ||H (B f - b)||² / 2 + w P(f) is smallest, its slope vanishes on the pixels that are free:
inside the support, and not held at zero by f >= 0. That slope F(f, parameters) = 0 has

    df = -(∂F/∂f)^-1 (∂F/∂parameters) dparameters,   ∂F/∂f = B^T H^T H B + w P''(f) there,

symmetric and positive: conjugate gradients. P is smooth, as its corners are rounded off. With a
proximal map of the user's F is the step that leaves f in its place, which is not symmetric.
"""

from typing import Any, NamedTuple, no_type_check

import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Bool, Float

from .data_fit import DataFit
from .level import Scale
from .penalties import Penalty, Ridge, is_known
from .relative_cg import RelativeCG

_TOLERANCE, _STEPS = 1e-8, 2000


class Problem(NamedTuple):
    """Everything that the minimum depends on."""

    fit: DataFit
    data: Float[Array, "stack *data"]
    penalty: Any
    weight: Float[Array, ""]
    scale: Scale


def with_derivatives(
    problem: Problem, image: Float[Array, "stack *space"]
) -> Float[Array, "stack *space"]:
    """The minimiser ``image`` with derivatives in all parts of the problem, in both modes."""
    import optimistix.internal as optxi  # slow to import

    image = jax.lax.stop_gradient(image)
    if is_known(problem.penalty):
        slope, tags = _slope, frozenset({lx.positive_semidefinite_tag})
        solver: lx.AbstractLinearSolver = RelativeCG(_TOLERANCE, _STEPS)
    else:
        slope, tags = _moved, frozenset()
        solver = lx.GMRES(rtol=_TOLERANCE, atol=_TOLERANCE, restart=50, stagnation_iters=50)
    return optxi.implicit_jvp(_known, slope, (problem, image), tags, solver)[0]


@no_type_check  # a checked one is a closure, which JAX must not see here
def _known(inputs: tuple[Problem, Array]) -> tuple[Array, None]:
    return inputs[1], None


def objective(problem: Problem, images: Float[Array, "stack *space"]) -> Float[Array, ""]:
    """||H (B f - b)||² / 2 + w P(f), over L."""
    fit, penalty = problem.fit, problem.penalty
    total = fit.misfit(fit.modelled(images) - problem.data) / 2
    if isinstance(penalty, Penalty):
        delta = penalty.smoothing * problem.scale.image
        total = total + problem.weight * penalty.value(images, delta)
    elif isinstance(penalty, Ridge):
        total = total + problem.weight * jnp.sum(images**2) / 2
    return total / problem.scale.square


@no_type_check  # a checked one is a closure, which JAX must not see here
def _slope(image: Array, _: None, inputs: tuple[Problem, Array]) -> Array:
    """F: the slope on free pixels, and the image itself, which is zero, on others."""
    problem, images = inputs
    free = _free(problem.fit, images)
    inside = jnp.where(free, image, 0.0)
    return jnp.where(free, jax.grad(objective, argnums=1)(problem, inside), image)


def _free(fit: DataFit, images: Array) -> Bool[Array, "stack *space"]:
    held = (images <= 0) if fit.nonnegative else jnp.zeros(images.shape, bool)
    return fit.support & ~jax.lax.stop_gradient(held)


@no_type_check  # a checked one is a closure, which JAX must not see here
def _moved(image: Array, _: None, inputs: tuple[Problem, Array]) -> Array:
    """F: how far a step with a proximal map moves the image."""
    fit, data, penalty, weight, scale = inputs[0]
    down = image - fit.transposed(fit.modelled(image) - data) / scale.square
    return image - fit.allowed(penalty(down, weight / scale.square))
