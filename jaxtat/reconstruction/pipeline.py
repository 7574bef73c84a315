"""Steps 2 to 5 in a row: from circular integrals to the image. Only this file knows the plan."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..checks import Numbers, dtype_of, real_array
from ..plan import ReconstructionPlan
from .fbp import filtered_back_projection
from .polar_fourier import polar_fourier
from .radial_transform import radial_transform, total_integrals
from .radon import LowPass, low_pass_values, offset_step, radon_projections


def reconstruct(
    plan: ReconstructionPlan, g: Numbers, *, low_pass: LowPass | None = None
) -> Float[Array, "*batch x1 x2"]:
    """The image f on the plan's grid from its circular integrals g.

    Linear in g. Meaningful inside ``plan.region``; mask the rest with
    ``plan.region.contains(plan.grid.points)``.

    Args:
        plan: from `build_plan` or `load_plan`.
        g: g(z, r) = ∫_{|x - z| = r} f dl, float32 or float64, (..., detectors, radii).
        low_pass: eta(lambda / lambda_max), for instance `cosine_filter`; none by default.

    Returns:
        (..., x1, x2), the unit of g per length.

    Raises:
        ValueError: for data of the wrong shape or dtype, or with NaN.

    Source: Kunyansky 2008, section 3.
    """
    g = _data(plan, g)
    n = plan.frequencies.shape[0]
    if not (low_pass is None or callable(low_pass)):
        raise ValueError(f"low_pass is {low_pass!r}, expected a function such as cosine_filter.")
    eta = real_array("low_pass", low_pass_values(low_pass, n), (n + 1,))
    return _reconstruct(plan, g, eta)


@eqx.filter_jit
def _reconstruct(plan: ReconstructionPlan, g: Array, eta: Array) -> Array:
    transformed = radial_transform(g, plan.radii, plan.frequencies)
    mass = total_integrals(g, plan.radii)
    fhat = polar_fourier(transformed, plan.densities, plan.curve.weights, mass)
    projections = radon_projections(fhat, plan.frequency_step, eta)
    step = offset_step(plan.frequency_step, plan.frequencies.shape[0])
    return filtered_back_projection(projections, step, plan.angles, plan.grid, plan.region.center)


def _data(plan: ReconstructionPlan, g: Numbers) -> Array:
    dtype = dtype_of("g", g)
    if not jnp.issubdtype(dtype, jnp.floating):
        raise ValueError(
            f"g has dtype {dtype}, expected float64 or float32 circular integrals; "
            "raw counts go through condition_record and pressure_to_circular_integrals first."
        )
    return real_array("g", g, ("...", plan.curve.n_detectors, plan.radii.shape[0]))
