"""What a user would take instead, on the same data."""

import numpy as np
import pytest
import scipy.linalg
import scipy.special
from problems import problem


def bench_scipy_densities_of_one_frequency(measure):
    """Step 1 as the paper writes it, in numpy and scipy, at the highest frequency."""
    case = problem(129)
    z, w = np.asarray(case.curve.points), np.asarray(case.curve.weights)
    x, v, normal = (
        np.asarray(part) for part in (case.region.points, case.region.weights, case.region.normals)
    )
    frequency = 64 * np.pi
    angles = np.arange(256) * np.pi / 256

    def densities():
        difference = x[:, None] - z
        distance = np.linalg.norm(difference, axis=-1)
        cosine = np.einsum("xzi,xi->xz", difference, normal) / distance
        argument, scale = frequency * distance, np.sqrt(v)[:, None] * np.sqrt(w)
        matrix = np.block(
            [
                [scale * scipy.special.j0(argument), scale * scipy.special.y0(argument)],
                [
                    -scale * cosine * scipy.special.j1(argument),
                    -scale * cosine * scipy.special.y1(argument),
                ],
            ]
        )
        xi = frequency * np.stack([np.cos(angles), np.sin(angles)])
        wave = np.exp(-1j * x @ xi) * np.sqrt(v)[:, None]
        traces = np.concatenate([wave, -1j * (normal @ xi / frequency) * wave])
        left, sigma, right = scipy.linalg.svd(matrix, full_matrices=False, check_finite=False)
        kept = sigma > 1e-12 * sigma[0]
        return right[kept].T @ ((left[:, kept].T @ traces) / sigma[kept, None])

    measure(densities, n=129, rounds=1)


@pytest.mark.parametrize("n", [129, 257])
def bench_skimage_iradon(measure, n):
    """Step 5 from exact Radon projections: scikit-image, cubic interpolation."""
    transform = pytest.importorskip("skimage.transform")
    case = problem(n)
    n_views = 2 * (n - 1)
    angles = np.arange(n_views) * np.pi / n_views
    offsets = np.linspace(-1, 1, n)
    projections = np.asarray(case.phantom.radon(angles, offsets))

    def image():
        # its y axis points down and its angles turn the other way
        found = transform.iradon(
            projections.T / (2 / (n - 1)), np.degrees(angles), n, interpolation="cubic"
        )
        return np.rot90(found, -1)

    measure(image, n=n, error=case.error, rounds=3)
