"""docs/pictures/image_model.png, and the table of docs/forward.md: what an image is between pixels.

    python scripts/figure_image_model.py

Data of a smooth bell and of a disk, exact and as two models of the image give them.
"""

from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

import jaxtat

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "image_model.png"


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    curve, region = jaxtat.circular_arc(1.3, 1.0, 500), jaxtat.disk(1.0)
    setup = jaxtat.Setup(curve, region, jaxtat.ImageGrid(129))
    models = {
        "band-limited": jaxtat.forward_operator(setup),
        "with the cosine window": jaxtat.forward_operator(setup, low_pass="cosine"),
    }
    objects = {
        "bell": jaxtat.phantoms.Bells([[0.1, 0.2]], [0.6]),
        "disk": jaxtat.phantoms.Disks([[0.1, 0.2]], [0.4]),
    }
    figure, axes = plt.subplots(1, 2, figsize=(9, 3), layout="constrained")
    for axis, (name, thing) in zip(axes, objects.items(), strict=True):
        exact = np.asarray(thing.circular_integrals(setup.curve, setup.radii))
        axis.set(title=f"{name}: error of the data", xlabel="r", yscale="log", ylim=(1e-10, 1))
        for model, apply in models.items():
            found = np.asarray(apply(thing.image(setup.grid)))
            errors = np.abs(found - exact) / exact.max()
            rms = np.linalg.norm(found - exact) / np.linalg.norm(exact)
            print(f"{name:5} {model:24} largest {errors.max():.1e}   L2 {rms:.1e}")
            axis.plot(setup.radii, np.maximum(errors[250], 1e-10), label=model)
    axes[0].legend()
    figure.savefig(PICTURE, dpi=150)


if __name__ == "__main__":
    main()
