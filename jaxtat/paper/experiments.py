"""What the paper measures in its section 4, for one geometry: images, errors, noise."""

import resource
import time
from dataclasses import dataclass, field
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..densities import plane_wave, potential
from ..phantoms import Bells, Disks, noise_like
from ..reconstruction import PAPER_K, ReconstructionPlan, build_plan, reconstruct
from ..regularization import NormBound
from ..steps import classical_fbp, cosine_filter, offset_step
from .cases import Case

NOISE_LEVEL = 0.15
SEED = 2008
by_paper = partial(reconstruct, inversion="fbp")  # step 5 as in the paper


@dataclass
class Results:
    """Numbers for metrics.json, and images for the figures, by name."""

    case: Case
    plan: ReconstructionPlan
    metrics: dict[str, float]
    images: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def inside(self) -> np.ndarray:
        """Which pixels lie in the region of interest."""
        return np.asarray(self.case.setup.region.contains(self.case.setup.grid.points))

    def show(self, name: str, image: Array) -> np.ndarray:
        """Keep an image for the figures, blank outside the region; returns it unblanked."""
        values = np.asarray(image)
        self.images[name] = np.where(self.inside, values, np.nan)
        return values

    def errors(self, image: Array, exact: Array) -> tuple[float, float]:
        """Largest, and relative L2, error over the pixels of the region."""
        difference = np.asarray(image - exact)[self.inside]
        relative = np.linalg.norm(difference) / np.linalg.norm(np.asarray(exact)[self.inside])
        return float(np.abs(difference).max()), float(relative)

    def deviation(self, image: Array) -> float:
        """Standard deviation over the pixels of the region."""
        return float(np.asarray(image)[self.inside].std())


def run_case(case: Case, progress: bool) -> Results:
    """Plan, plane wave, smooth phantom, disks with and without noise, classical FBP."""
    start = time.perf_counter()
    plan = build_plan(case.setup, NormBound(PAPER_K), progress=progress)
    results = Results(case, plan, {"plan_seconds": time.perf_counter() - start})
    nyquist_plane_wave(results)
    smooth_phantom(results)
    disk_phantom(results)
    classical_yardstick(results)
    usage = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    results.metrics["peak_memory_mb"] = usage / 1024
    return results


def nyquist_plane_wave(results: Results) -> None:
    """Error of the vertical plane wave at the highest frequency, over all of the region."""
    plan, grid = results.plan, results.case.setup.grid
    frequency, vertical = plan.frequencies[-1], plan.angles.shape[0] // 2
    chosen = slice(vertical, vertical + 1)
    last = plan.densities.of_frequency(len(plan.frequencies) - 1, plan.curve.weights)
    wave = potential(frequency, last[chosen], plan.curve, grid.points)[..., 0]
    exact = plane_wave(frequency, plan.angles[chosen], grid.points - plan.region.center)[..., 0]
    error = results.show("plane wave error", jnp.log10(jnp.abs(wave - exact) + 1e-16))
    results.metrics["nyquist_plane_wave_max_error"] = float(10 ** error[results.inside].max())


def smooth_phantom(results: Results) -> None:
    """Reconstruction from exact data of the bells, and how long it takes."""
    case, plan = results.case, results.plan
    g = case.smooth.circular_integrals(case.setup.curve, case.setup.radii)
    exact = case.smooth.image(case.setup.grid)
    image = by_paper(plan, g)
    results.show("smooth", image)
    results.show("smooth error", image - exact)
    most, relative = results.errors(image, exact)
    results.metrics |= {
        "smooth_max_error": most,
        "smooth_rel_l2": relative,
        "reconstruct_milliseconds": 1e3 * _median_seconds(lambda: by_paper(plan, g)),
    }


def disk_phantom(results: Results) -> None:
    """Disks: clean, with 15 % noise, and with noise and the cosine filter (figures 2 and 3)."""
    case, plan = results.case, results.plan
    g = case.disks.circular_integrals(case.setup.curve, case.setup.radii)
    noise = noise_like(jax.random.key(SEED), g, NOISE_LEVEL)
    exact = case.disks.image(case.setup.grid)
    clean, of_noise = by_paper(plan, jnp.stack([g, noise]))
    clean_filtered, of_noise_filtered = by_paper(
        plan, jnp.stack([g, noise]), low_pass=cosine_filter
    )
    results.show("disks exact", exact)
    results.show("disks", clean)
    results.show("disks noisy", clean + of_noise)
    results.show("disks noisy filtered", clean_filtered + of_noise_filtered)
    results.metrics |= {
        "disks_rel_l2": results.errors(clean, exact)[1],
        "noise_std": results.deviation(of_noise),
        "noise_std_filtered": results.deviation(of_noise_filtered),
    }


def classical_yardstick(results: Results) -> None:
    """Filtered back-projection of exact Radon projections of the disks with 15 % noise.

    Its projections lie on the plan's own polar grid (as many directions, offsets a pixel apart,
    zero beyond the shadow of the region) and pass the same steps 4 and 5. The noise of a second
    run with as many views as there are detectors is reported too: the same number of data.
    """
    case, plan = results.case, results.plan
    n = plan.frequencies.shape[0]
    step = offset_step(plan.frequency_step, n)
    offsets = (jnp.arange(2 * n) - n) * step
    shadow = jnp.abs(offsets) <= plan.region.reach
    for suffix, n_views in (
        ("", plan.angles.shape[0]),
        ("_as_many_data", case.setup.curve.n_detectors),
    ):
        angles = jnp.arange(n_views) * jnp.pi / n_views
        clean = case.disks.radon(angles, offsets)
        noise = noise_like(jax.random.key(SEED + 1), clean[:, shadow], NOISE_LEVEL)
        both = jnp.stack([clean, jnp.zeros_like(clean).at[:, shadow].set(noise)])
        where = (step, angles, case.setup.grid, plan.region.center)
        image, of_noise = classical_fbp(both, *where)
        image_filtered, of_noise_filtered = classical_fbp(both, *where, low_pass=cosine_filter)
        results.metrics |= {
            f"fbp_noise_std{suffix}": results.deviation(of_noise),
            f"fbp_noise_std_filtered{suffix}": results.deviation(of_noise_filtered),
        }
        if not suffix:
            results.show("fbp", image)
            results.show("fbp noisy", image + of_noise)
            results.show("fbp noisy filtered", image_filtered + of_noise_filtered)


def outside_sources(results: Results, phantom: Bells | Disks) -> dict[str, float]:
    """Errors inside the region for a phantom that reaches beyond it (figure 4)."""
    case = results.case
    image = by_paper(results.plan, phantom.circular_integrals(case.setup.curve, case.setup.radii))
    exact = phantom.image(case.setup.grid)
    results.show("outside", image)
    results.show("outside error", image - exact)
    results.images["outside exact"] = np.asarray(exact)
    most, relative = results.errors(image, exact)
    return {"roi_rel_l2": relative, "roi_max_error": most}


def _median_seconds(work, repeats: int = 7) -> float:
    """Median wall time of a call that has been compiled already."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(work())
        times.append(time.perf_counter() - start)
    return float(np.median(times))
