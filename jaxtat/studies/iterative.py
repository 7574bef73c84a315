"""The general-purpose alternative: iterations with the forward operator and its adjoint.

Any inverse problem can be solved so, without a formula for this one. For few detectors, gaps in the
record or sharp edges it is of use by itself. The unknowns are the pixels of a band-limited image,
as in `forward_operator`.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from ..base.checks import (
    Numbers,
    data_array,
    is_concrete,
    real_array,
    require_positive,
    whole_number,
)
from ..reconstruction import ForwardOperator, Setup, forward_operator
from ..reconstruction.setup import plane_of


class IterativeReconstruction(eqx.Module):
    """An image and how it was obtained.

    Attributes:
        image: f, (x1, x2), the unit of g per length.
        iterations: steps taken.
        residual: ||A f - g|| / ||g||.
        converged: whether the tolerance was met before ``max_steps``.
    """

    image: Float[Array, "x1 x2"]
    iterations: Int[Array, ""]
    residual: Float[Array, ""]
    converged: Bool[Array, ""]


def least_squares(
    setup: Setup,
    g: Numbers,
    alpha: Numbers = 0.0,
    *,
    everywhere: bool = False,
    tolerance: float = 1e-6,
    max_steps: int = 50,
) -> IterativeReconstruction:
    """The image that minimises ||A f - g||² + alpha ||f||², A the circular integrals.

    By conjugate gradients on (A^T A + alpha) f = A^T g from f = 0. With alpha = 0 the number of
    steps regularises: noise enters late, so poor data want few. Differentiable with respect to g,
    alpha, radii and detectors, implicitly: as if converged, by as many steps at most.

    Args:
        setup: in the plane.
        g: circular integrals, float32 or float64, (detectors, radii).
        alpha: zero or more [length²].
        everywhere: f may differ from zero on all of the grid, not only in the region.
        tolerance: at which to stop, for ||A^T (g - A f) - alpha f|| / ||A^T g|| and for the last
            step, both in the 2-norm, the step in units of A^T g / ||A||².
        max_steps: the most iterations, each one forward and one adjoint operation.

    Returns:
        IterativeReconstruction.

    Raises:
        ValueError: for data that do not fit, NaN, alpha below zero, a tolerance that is not
            positive or less than one step.

    Source: Hestenes and Stiefel, J. Res. Nat. Bur. Standards 49 (1952) 409-436.

    >>> from jaxtat import ImageGrid, circular_arc, disk, phantoms
    >>> setup = Setup(circular_arc(1.3, 1.0, 30), disk(1.0), ImageGrid(15))
    >>> bell = phantoms.Bells([[0.1, 0.2]], [0.7])
    >>> found = least_squares(setup, bell.circular_integrals(setup.curve, setup.radii))
    >>> error = abs(found.image - bell.image(setup.grid)).max()
    >>> bool(found.residual < 0.01), bool(error < 0.1)
    (True, True)
    """
    model, data = _model(setup, g, everywhere)
    alpha = real_array("alpha", alpha, ())
    if is_concrete(alpha) and float(alpha) < 0:
        raise ValueError(f"alpha is {float(alpha)}, expected zero or more.")
    # an array, so that another number of steps needs no other program
    steps = jnp.asarray(whole_number("max_steps", max_steps, 1))
    return _conjugate_gradients(model, data, alpha, _tolerance(tolerance), steps)


def total_variation(
    setup: Setup,
    g: Numbers,
    weight: Numbers,
    *,
    smoothing: Numbers = 1e-2,
    everywhere: bool = False,
    initial: Numbers | None = None,
    tolerance: float = 1e-4,
    max_steps: int = 100,
) -> IterativeReconstruction:
    """The image that minimises ||A f - g||² / 2 + weight TV(f), for objects with sharp edges.

    TV(f) = Σ √(d_1 f² + d_2 f² + eps²), d differences to the next pixel. By the limited-memory
    method of Broyden, Fletcher, Goldfarb and Shanno. For white noise of variance sigma² the minimum
    is the most probable image if gradients have the density exp(-(weight/sigma²) |d f|).
    Differentiable with respect to g, weight and smoothing, implicitly: as if converged.

    Args:
        setup, g, everywhere: as in `least_squares`.
        weight: above zero [length times the unit of g].
        smoothing: eps > 0, below which differences count as flat [unit of f].
        initial: image to start from, (x1, x2); zero by default.
        tolerance: at which to stop: largest change of a pixel, relative to itself plus the size of
            A^T g / ||A||², and relative change of what is minimised.
        max_steps: the most iterations, each one forward and one adjoint operation.

    Returns:
        IterativeReconstruction.

    Raises:
        ValueError: for data or an initial image that do not fit, NaN, a weight, smoothing or
            tolerance that is not positive, or less than one step.

    Source: Rudin, Osher and Fatemi, Physica D 60 (1992) 259-268; Liu and Nocedal, Math. Program.
    45 (1989) 503-528.
    """
    model, data = _model(setup, g, everywhere)
    weight, smoothing = real_array("weight", weight, ()), real_array("smoothing", smoothing, ())
    require_positive("weight", weight)
    require_positive("smoothing", smoothing)
    start = jnp.zeros(setup.grid.shape) if initial is None else initial
    start = jnp.where(model.support, real_array("initial", start, setup.grid.shape), 0.0)
    steps = whole_number("max_steps", max_steps, 1)
    return _quasi_newton(model, data, weight, smoothing, start, _tolerance(tolerance), steps)


def smoothed_variation(
    image: Float[Array, "x1 x2"], smoothing: Float[Array, ""]
) -> Float[Array, ""]:
    """TV(f) = Σ √(d_1 f² + d_2 f² + eps²) over all pixels; differences across the edge are 0.

    >>> step = jnp.zeros((4, 6)).at[:, 3:].set(2.0)
    >>> round(float(smoothed_variation(step, jnp.array(1e-12))), 9)  # height times length
    8.0
    """
    d1 = jnp.diff(image, axis=0, append=image[-1:])
    d2 = jnp.diff(image, axis=1, append=image[:, -1:])
    return jnp.sum(jnp.sqrt(d1**2 + d2**2 + smoothing**2))


class _Model(eqx.Module):
    """A, from pixels in the support to circular integrals, and A^T."""

    operator: ForwardOperator
    support: Bool[Array, "x1 x2"]

    def forward(self, image: Float[Array, "x1 x2"]) -> Float[Array, "detectors radii"]:
        return self.operator.mv(jnp.where(self.support, image, 0.0))

    def adjoint(self, data: Float[Array, "detectors radii"]) -> Float[Array, "x1 x2"]:
        return jnp.where(self.support, self.operator.T.mv(data), 0.0)

    def units(self, back: Float[Array, "x1 x2"]) -> Float[Array, ""]:
        """||A b||² / ||b||² of b = A^T g: nearly ||A||², as b is smooth; 1 for b = 0."""
        square = jnp.sum(back**2)
        safe = jnp.where(square > 0, square, 1.0)
        return jnp.where(square > 0, jnp.sum(self.forward(back) ** 2) / safe, 1.0)


def _model(
    setup: Setup, g: Numbers, everywhere: bool
) -> tuple[_Model, Float[Array, "detectors radii"]]:
    """The operator and the data, checked."""
    _, region, _, _ = plane_of(setup)
    data = data_array(g, *setup.data_shape)
    if data.ndim != 2:
        raise ValueError(f"g has shape {data.shape}, expected one image's {data.shape[-2:]}.")
    inside = jnp.ones(setup.grid.shape, bool) if everywhere else region.contains(setup.grid.points)
    return _Model(forward_operator(setup), inside), data


class _RelativeCG(lx.AbstractLinearSolver):
    """Conjugate gradients that stop where residual and last step are small beside the right side.

    Relative tolerances of `lineax.CG` are elementwise, met last by pixels that hold nothing, and
    the absolute one would call derivatives of small size solved before the first step.
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
        size = _norm(vector)
        size = jnp.where(size > 0, size, 1.0)
        value, result, stats = self.solver.compute(state, vector / size, options)
        return size * value, result, stats

    def transpose(self, state: Any, options: dict[str, Any]) -> Any:
        return self.solver.transpose(state, options)

    def conj(self, state: Any, options: dict[str, Any]) -> Any:
        return self.solver.conj(state, options)

    def assume_full_rank(self) -> bool:
        return True


def _tolerance(tolerance: Any) -> Array:
    value = real_array("tolerance", tolerance, ())
    require_positive("tolerance", value)
    return value


@eqx.filter_jit
def _conjugate_gradients(
    model: _Model, g: Array, alpha: Array, tolerance: Array, max_steps: Array
) -> IterativeReconstruction:
    """Solved in units in which ||A|| is about 1, so that residuals and steps have one size."""
    back = model.adjoint(g)
    square = jax.lax.stop_gradient(model.units(back))

    def normal(image: Array) -> Array:
        return (model.adjoint(model.forward(image)) + alpha * image) / square

    operator = lx.FunctionLinearOperator(
        normal, jax.ShapeDtypeStruct(back.shape, back.dtype), lx.positive_semidefinite_tag
    )
    solver = _RelativeCG(tolerance, max_steps)
    found = lx.linear_solve(operator, back / square, solver, throw=False)
    return _report(
        model, found.value, g, found.stats["num_steps"], found.result == lx.RESULTS.successful
    )


@eqx.filter_jit
def _quasi_newton(
    model: _Model,
    g: Array,
    weight: Array,
    smoothing: Array,
    start: Array,
    tolerance: Array,
    max_steps: int,
) -> IterativeReconstruction:
    """Solved for u = f / scale, where what is minimised has second derivatives of about 1."""
    back = jax.lax.stop_gradient(model.adjoint(g))
    square = model.units(back)
    scale = jnp.max(jnp.abs(back)) / square
    scale = jnp.where(scale > 0, scale, 1.0)

    def objective(u: Array, given: tuple[_Model, Array, Array, Array]) -> Array:
        model, g, weight, smoothing = given
        image = jnp.where(model.support, scale * u, 0.0)
        misfit = jnp.sum((model.forward(image) - g) ** 2) / 2
        return (misfit + weight * smoothed_variation(image, smoothing)) / (square * scale**2)

    found = optx.minimise(
        objective,
        optx.LBFGS(rtol=tolerance, atol=tolerance),  # pyright: ignore[reportArgumentType]
        start / scale,
        (model, g, weight, smoothing),
        max_steps=max_steps,
        adjoint=optx.ImplicitAdjoint(_RelativeCG(tolerance=1e-8, max_steps=1000)),
        tags=frozenset({lx.positive_semidefinite_tag}),
        throw=False,
    )
    image = jnp.where(model.support, scale * found.value, 0.0)
    converged = found.result == optx.RESULTS.successful
    return _report(model, image, g, found.stats["num_steps"], converged)


def _report(
    model: _Model, image: Array, g: Array, iterations: Array, converged: Array
) -> IterativeReconstruction:
    size = _norm(g)
    misfit = _norm(model.forward(image) - g) / jnp.where(size > 0, size, 1.0)
    return IterativeReconstruction(image, jnp.asarray(iterations), misfit, jnp.asarray(converged))


def _norm(array: Array) -> Float[Array, ""]:
    """2-norm with derivative 0, not NaN, at 0."""
    square = jnp.sum(array**2)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
