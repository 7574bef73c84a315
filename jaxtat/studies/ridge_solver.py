"""Tikhonov's densities by iterations: what a user would do without a singular value decomposition.

jaxopt minimises ||A q - u||² + alpha ||q||². It is no longer maintained, and says so when it is
imported: that happens in here, on use, and nowhere else.
"""

import warnings
from types import ModuleType

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

from ..base.checks import Numbers, real_array, require_positive, whole_number


class RidgeSolution(eqx.Module):
    """A minimiser, with the number of iterations and the norm of the gradient.

    Attributes:
        q: (blocks, unknowns, rhs).
        iterations: of the method of Broyden, Fletcher, Goldfarb and Shanno.
        error: norm of the gradient, over its norm at q = 0.
        converged: whether that is as small as was asked.
    """

    q: Complex[Array, "blocks unknowns rhs"]
    iterations: Int[Array, ""]
    error: Float[Array, ""]
    converged: Bool[Array, ""]


@eqx.filter_jit
def ridge(
    blocks: Float[Array, "blocks equations unknowns"],
    rhs: Complex[Array, "blocks equations rhs"],
    alpha: Numbers,
    *,
    tolerance: float = 1e-6,
    max_steps: int = 1000,
) -> RidgeSolution:
    """q = argmin ||A q - u||² + alpha ||q||² by jaxopt: `Tikhonov` without singular values.

    By the limited-memory method of Broyden, Fletcher, Goldfarb and Shanno from q = 0, for all
    right-hand sides at once. Derivatives are implicit ones, in both modes.

    Args:
        blocks: of A, real.
        rhs: u, complex, one column per right-hand side.
        alpha: above zero, in the unit of A A^T.
        tolerance: for the norm of the gradient, over its norm at q = 0.
        max_steps: the most iterations.

    Returns:
        RidgeSolution.

    Raises:
        ValueError: for alpha that is not positive, or less than one step.

    Source: Liu and Nocedal, Math. Program. 45 (1989) 503-528; jaxopt, M. Blondel et al., NeurIPS
    35 (2022), "Efficient and modular implicit differentiation".

    >>> u = jnp.array([[[4.0], [2.0]]]) + 0j
    >>> result = ridge(jnp.diag(jnp.array([2.0, 1.0]))[None], u, 1.0)
    >>> [round(float(q), 5) for q in result.q.real[0, :, 0]], bool(result.converged)
    ([1.6, 1.0], True)
    """
    alpha = real_array("alpha", alpha, ())
    require_positive("alpha", alpha)
    max_steps = whole_number("max_steps", max_steps, 1)
    # in units in which A A^T has diagonal entries up to 1, and the gradient at q = 0 the norm 1
    unit = jnp.sqrt(jax.lax.stop_gradient(jnp.sum(blocks**2, axis=-1).max()))
    matrix, damping = blocks / unit, alpha / unit**2
    columns = jnp.concatenate([rhs.real, rhs.imag], axis=-1)  # real: jaxopt's solvers know no other
    size = jax.lax.stop_gradient(jnp.linalg.norm(_transposed(matrix) @ columns))
    size = jnp.where(size > 0, size, 1.0)
    solution, steps, error = _minimiser(matrix, columns / size, damping, tolerance, max_steps)
    real, imaginary = jnp.split(solution * (size / unit), 2, axis=-1)
    return RidgeSolution(jax.lax.complex(real, imaginary), steps, error, error <= tolerance)


def _minimiser(
    matrix: Array, columns: Array, damping: Array, tolerance: float, max_steps: int
) -> tuple[Array, Array, Array]:
    """q, iterations and the norm of the gradient."""
    jaxopt = _jaxopt()

    def objective(q: Array, matrix: Array, columns: Array, damping: Array) -> Array:
        misfit = matrix @ q - columns
        return (jnp.sum(misfit**2) + damping * jnp.sum(q**2)) / 2

    # q is in units of columns: the first step of a line search may be long
    solver = jaxopt.LBFGS(
        objective, maxiter=max_steps, tol=tolerance, max_stepsize=1e3, implicit_diff=False
    )
    start = jnp.zeros((matrix.shape[0], matrix.shape[2], columns.shape[-1]))
    system = matrix, columns, damping
    solution, state = solver.run(start, *jax.lax.stop_gradient(system))

    # Where the gradient vanishes, dq = -H^-1 d(gradient), H = A^T A + alpha: a change of zero with
    # this derivative. jaxopt's own implicit derivatives are for reverse mode alone.
    gradient = jax.grad(objective)(solution, *system)
    no_change = jaxopt.linear_solve.solve_cg(
        lambda q: _transposed(matrix) @ (matrix @ q) + damping * q,
        gradient - jax.lax.stop_gradient(gradient),
        tol=1e-14,
        maxiter=10 * matrix.shape[-1],
    )
    solution = solution - no_change
    return solution, state.iter_num, state.error


def _jaxopt() -> ModuleType:
    """jaxopt, or a one-line ImportError: it imports names that JAX may remove."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            import jaxopt
    except (ImportError, AttributeError) as error:
        raise ImportError(
            f"jaxopt, which is no longer maintained, does not work beside JAX {jax.__version__} "
            f"({error}): use Tikhonov(alpha) in build_plan, which needs no iterations."
        ) from error
    return jaxopt


def _transposed(matrix: Array) -> Array:
    return jnp.swapaxes(matrix, -1, -2)
