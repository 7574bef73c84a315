"""Steps 2 to 5 in a row: from circular integrals to the image. Only this file knows the plan."""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Float

from ..checks import Numbers, data_array
from ..parallel import checked_mesh, map_shards, replicated
from ..plan import ReconstructionPlan
from .inversion import invert, require_inversion
from .polar_fourier import polar_fourier
from .radial_transform import radial_transform, total_integrals
from .radon import LowPass, low_pass_values

# reconstructed together: enough for matrix products, few enough for the cache
IMAGES = {"fbp": 32, "fourier": 16}


def reconstruct(
    plan: ReconstructionPlan,
    g: Numbers,
    *,
    low_pass: LowPass | None = None,
    inversion: str = "fbp",
    mesh: Mesh | None = None,
) -> Float[Array, "*batch x1 x2"]:
    """The image f on the plan's grid from its circular integrals g.

    Linear in g. Meaningful inside ``plan.region``; mask the rest with
    ``plan.region.contains(plan.grid.points)``.

    Args:
        plan: from `build_plan` or `load_plan`.
        g: g(z, r) = ∫_{|x - z| = r} f dl, float32 or float64, (..., detectors, radii).
        low_pass: eta(lambda / lambda_max), such as `cosine_filter` or "cosine"; none by default.
        inversion: "fbp", or "fourier": faster, see `inversion.invert`.
        mesh: devices among which the images of a batch are divided, see `jaxtat.parallel`.

    Returns:
        (..., x1, x2), the unit of g per length.

    Raises:
        ValueError: for data of the wrong shape or dtype, or with NaN.

    Source: Kunyansky 2008, section 3.
    """
    data = data_array(g, plan.curve.n_detectors, plan.radii.shape[0])
    n = plan.frequencies.shape[0]
    eta = low_pass_values(low_pass, n)
    require_inversion(inversion)
    mesh = checked_mesh(mesh)
    plan, data, eta = replicated((plan, data, eta), mesh)
    return _reconstruct(plan, data, eta, inversion, mesh)


@eqx.filter_jit
def _reconstruct(
    plan: ReconstructionPlan, g: Array, eta: Array, inversion: str, mesh: Mesh | None
) -> Array:
    def of_group(plan: ReconstructionPlan, eta: Array, g: Array) -> Array:
        transformed = radial_transform(g, plan.radii, plan.frequencies)
        mass = total_integrals(g, plan.radii)
        fhat = polar_fourier(transformed, plan.densities, plan.curve.weights, mass)
        return invert(
            fhat, plan.frequency_step, plan.angles, plan.grid, plan.region.center, eta, inversion
        )

    stack = g.reshape(-1, *g.shape[-2:])
    images = map_shards(
        lambda common, part: in_groups(partial(of_group, *common), part, IMAGES[inversion]),
        (plan, eta),
        stack,
        mesh,
    )
    return images.reshape(*g.shape[:-2], *plan.grid.shape)


def in_groups(work: Callable[[Array], Array], stack: Array, size: int) -> Array:
    """``work`` on a stack of data, some at a time, so that what it needs besides stays bounded.

    Args:
        work: (n, detectors, radii) -> (n, x1, x2), image by image.
        stack: (n, detectors, radii).
        size: the most at a time; the last group is filled up with zeros.
    """
    n, n_groups = stack.shape[0], -(-stack.shape[0] // size)
    if n_groups <= 1:
        return work(stack)
    size = -(-n // n_groups)
    padded = jnp.pad(stack, ((0, n_groups * size - n), (0, 0), (0, 0)))
    found = jax.lax.map(work, padded.reshape(n_groups, size, *stack.shape[1:]))
    return found.reshape(-1, *found.shape[2:])[:n]
