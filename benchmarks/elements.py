"""What the model of elements of finite width brings: how wide a point is beside the centre.

Exact data of a bell three pixels wide, at the centre and at 0.8 of the region's radius, recorded by
wide elements on an arc and reconstructed with the model of these elements and with that of point
detectors. Printed are full widths at half of the largest value, along the radius and across it
(tangential), in pixels.

    python benchmarks/elements.py [--pixels 257] [--detectors 512] [--noise 0.01] [--alpha 1e-3]
"""

import argparse
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

import jaxtat

BELL = 1.5  # pixels from its centre to its edge
WIDTHS = 3.0, 6.0  # of elements, in pixels
SHOWN, FINER = 6, 8  # pixels to either side of the bell, and nodes in one of them


def full_width(profile: np.ndarray) -> float:
    """Between the points at half of the largest value, on straight lines between nodes [pixels]."""
    half, peak = profile.max() / 2, int(profile.argmax())
    right = next(k for k in range(peak, len(profile)) if profile[k] < half)
    left = next(k for k in range(peak, -1, -1) if profile[k] < half)
    high = right - 1 + (profile[right - 1] - half) / (profile[right - 1] - profile[right])
    low = left + (half - profile[left]) / (profile[left + 1] - profile[left])
    return (high - low) / FINER


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--pixels", type=int, default=257)
    parser.add_argument("--detectors", type=int, default=512)
    parser.add_argument("--noise", type=float, default=0.0, help="relative to the data, 2-norm")
    parser.add_argument("--alpha", type=float, default=1e-6, help="the default of exact data")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    pixel = 2 / (options.pixels - 1)
    points = jaxtat.circular_arc(1.3, 1.0, options.detectors, element_width=0.0)
    region = jaxtat.disk(1.0)
    radii = jaxtat.data_radii(points, region, pixel / 2)
    shown = 2 * SHOWN * FINER + 1, SHOWN * pixel
    highest = np.pi / pixel
    setup = jaxtat.Setup(points, region, jaxtat.ImageGrid(*shown), radii, max_frequency=highest)
    print(f"{options}, bell {2 * BELL:g} pixels wide")
    print("element  bell at  model     radial  tangential   peak")
    for width in WIDTHS:
        wide = replace(points, element_width=jnp.array(width * pixel))
        for place in (0.0, 0.8):
            center = np.array([-place, 0.0])
            bell = jaxtat.phantoms.Bells([center], [BELL * pixel])
            g = bell.circular_integrals(wide, radii, n_nodes=64)
            g += jaxtat.phantoms.noise_like(jax.random.key(0), g, options.noise)
            near = setup.replace(grid=jaxtat.ImageGrid(*shown, center))
            for model, curve in {"elements": wide, "points": points}.items():
                found = jaxtat.solve(near.replace(curve=curve), g, options.alpha)
                image = np.asarray(found.image)
                i, j = np.unravel_index(image.argmax(), image.shape)
                radial, tangential = full_width(image[:, j]), full_width(image[i])
                print(
                    f"{width:7g}  {place:7.1f}  {model:8}  {radial:6.2f}  {tangential:10.2f}  "
                    f"{image.max():5.3f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
