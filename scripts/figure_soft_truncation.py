"""notebooks/soft_truncation.png: error of an image over K and j_max, with sharp and soft edges.

The paper's size (129 x 129 pixels, 500 detectors, geometry 2), bells with 15 % noise. One singular
value decomposition per frequency serves all K and j_max: fhat(xi) = (1/2π) Σ_j phi_j p_j, of which
only the factors phi_j change. Run from the root of a checkout.
"""

import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxtat
from jaxtat.densities.cylindrical_waves import (
    frequency_groups,
    polar_geometry,
    wave_orders,
    wave_table,
)
from jaxtat.densities.cylindrical_waves.densities import fold, wave_system
from jaxtat.reconstruction.setup import plane_of
from jaxtat.regularization import singular_components, unit_norms
from jaxtat.steps import radial_transform, total_integrals
from jaxtat.steps.inversion import invert
from jaxtat.steps.polar_transform import with_origin

OUT = Path("notebooks/soft_truncation.png")
PIXELS, N_DETECTORS, NOISE = 129, 500, 0.15
SHARP, SOFT_K, SOFT_RANK = 0.0, 0.2, 5.0
K, J_MAX = np.geomspace(1.3, 8.0, 73), np.linspace(20.0, 260.0, 97)
CURVES = {
    "K": ((jaxtat.NormBound, SHARP), (jaxtat.NormBound, SOFT_K), K),
    "j_max": ((jaxtat.FixedRank, SHARP), (jaxtat.FixedRank, SOFT_RANK), J_MAX),
}


class Study(eqx.Module):
    """A problem, its data and the truth."""

    setup: jaxtat.Setup
    data: jax.Array
    truth: jax.Array

    @classmethod
    def of_size(cls, pixels: int, n_detectors: int) -> "Study":
        curve, grid = jaxtat.circular_arc(1.3, 0.0, n_detectors), jaxtat.ImageGrid(pixels)
        setup = jaxtat.Setup(curve, jaxtat.disk(1.0, 0.0), grid)
        bells = jaxtat.phantoms.Bells([[-0.45, 0.3], [-0.5, -0.3]], [0.35, 0.3])
        g = bells.circular_integrals(curve, setup.radii)
        data = g + jaxtat.phantoms.noise_like(jax.random.key(0), g, NOISE)
        return cls(setup, data, bells.image(grid))

    def error(self, image):
        """Relative L2 error in the region."""
        inside = self.setup.region.contains(self.setup.grid.points)
        off, all_of_it = (jnp.where(inside, f, 0.0) for f in (image - self.truth, self.truth))
        return jnp.linalg.norm(off) / jnp.linalg.norm(all_of_it)


def errors(study: Study, rules) -> list[tuple[np.ndarray, np.ndarray]]:
    """Errors and their slopes for (kind, softness, values) each."""
    curve, region, radii, sizes = plane_of(study.setup)
    frequencies, angles = sizes.frequencies, sizes.angles
    geometry = polar_geometry(curve, region)
    orders = wave_orders(geometry, np.asarray(frequencies))
    norms = unit_norms(curve, region, frequencies, angles=angles)
    transformed = radial_transform(study.data, radii, frequencies)
    folded = fold(transformed[..., None], curve.weights, geometry.mirror)[..., 0]
    table = wave_table(geometry, frequencies, int(orders.max()))
    pieces = []
    for part, n_max in frequency_groups(orders, 4):
        few = jax.tree.map(lambda leaf: leaf[part], (table, norms, folded))  # noqa: B023
        pieces.append(_transforms(geometry, n_max, angles - geometry.axis, few, rules))
    offset = region.center - geometry.center
    along = jnp.cos(angles) * offset[0] + jnp.sin(angles) * offset[1]
    phases = jnp.exp(1j * frequencies[:, None] * along)
    mass = total_integrals(study.data, radii)

    @jax.jit
    def of_fhat(fhat):
        whole = with_origin(fhat * phases, mass, curve.weights)
        eta, center = jnp.ones(len(frequencies) + 1), region.center
        image = invert(whole, frequencies[0], angles, study.setup.grid, center, eta, "fbp")
        return study.error(image)

    def errors_of(fhat, slope):  # values first
        pairs = [jax.jvp(of_fhat, (f,), (s,)) for f, s in zip(fhat, slope, strict=True)]
        return tuple(np.array(pairs).T)

    joined = jax.tree.map(lambda *parts: jnp.concatenate(parts, axis=1), *pieces)
    return [errors_of(*one) for one in joined]


@eqx.filter_jit
def _transforms(geometry, n_max, angles, few, rules):
    """fhat and its slope for all rules, (values, frequencies, directions)."""

    def at(given):
        wave, norm, data = given
        matrix, rhs, _, _ = wave_system(geometry, wave.up_to(n_max), angles)
        found = singular_components(matrix, rhs, jaxtat.FixedRank(0.0), norm)
        seen = (found.right @ data[..., None])[..., 0]
        parts = found.ordered(found.amplitudes * seen[..., None])
        size, sigma = found.ordered(jnp.abs(found.amplitudes)), found.singular_values

        def along(kind, softness, values):
            def fhat(value):
                phi = kind(value, softness=softness).factors(sigma, size, norm)
                return jnp.sum(phi * parts, axis=0) / (2 * jnp.pi)

            return jax.lax.map(lambda v: jax.jvp(fhat, (v,), (jnp.ones(()),)), jnp.asarray(values))

        return [along(*rule) for rule in rules]

    found = jax.lax.map(at, few)
    return jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, 1), found)


def trend(values: np.ndarray, found: np.ndarray, share: float = 0.025) -> np.ndarray:
    """Central differences over 2 share of the value, by interpolation of the curve."""
    low, high = (np.interp(values * (1 + sign * share), values, found) for sign in (-1, 1))
    inner = (values * (1 - share) >= values[0]) & (values * (1 + share) <= values[-1])
    return np.where(inner, (high - low) / (2 * share * values), np.nan)


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    study = Study.of_size(PIXELS, N_DETECTORS)
    rules = [(*edge, values) for *edges, values in CURVES.values() for edge in edges]
    found = errors(study, rules)
    plan = jaxtat.build_plan(study.setup, jaxtat.NormBound(K[36], softness=SOFT_K))
    by_plan = float(study.error(jaxtat.reconstruct(plan, study.data)))
    print(f"K = {K[36]:.3f}: error {found[1][0][36]:.8f}, by a plan {by_plan:.8f}")
    figure, axes = plt.subplots(2, 2, figsize=(11, 6.5), sharex="col", layout="constrained")
    for column, ((name, (*_, values)), curves) in enumerate(
        zip(CURVES.items(), (found[:2], found[2:]), strict=True)
    ):
        differences = np.stack([trend(values, error) for error, _ in curves])
        # slopes at kinks are off the scale: it is that of the differences
        low, high = np.nanmin(differences[1]), np.nanmax(differences[1])
        axes[1, column].set_ylim(low - 0.5 * (high - low), high + 0.5 * (high - low))
        for (error, slope), difference, label, style in zip(
            curves, differences, ("sharp edge", "soft edge"), ("C3", "C0"), strict=True
        ):
            axes[0, column].plot(values, error, style, label=label)
            axes[1, column].plot(values, slope, f"{style}.-", linewidth=0.6, markersize=4)
            axes[1, column].plot(values, difference, style, linewidth=3, alpha=0.3)
            largest = np.nanmax(np.abs(difference[len(values) // 4 :]))
            off = np.abs(slope - difference)[len(values) // 4 :] / largest
            print(f"{name}, {label}: slopes off by {np.nanmax(off):.3f} of the largest difference")
        axes[0, column].set(ylabel="relative L2 error")
        axes[0, column].legend()
        axes[1, column].set(xlabel=name, ylabel="slope (dots), differences over 5 %")
    figure.savefig(OUT, dpi=80)
    print(json.dumps({"least error over K": [float(curve[0].min()) for curve in found[:2]]}))


if __name__ == "__main__":
    main()
