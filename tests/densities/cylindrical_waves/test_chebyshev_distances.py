"""Waves at many distances from few, against scipy."""

import numpy as np
import pytest
import scipy.special

from jaxtat.densities.cylindrical_waves.chebyshev_distances import few_distances


@pytest.mark.parametrize(
    ("middle", "half", "frequency", "last"),
    [
        (40.5, 0.5, 25.7, 410),
        (40.5, 3.0, 25.7, 410),
        (40.5, 3.0, 0.12, 28),  # orders far beyond lambda r
        (40.5, 10.0, 0.12, 40),
        (1.3, 0.2, 30.0, 60),
    ],
)
@pytest.mark.parametrize(("dtype", "accuracy"), [(np.float32, 1e-8), (np.float64, 2e-12)])
def test_all_orders(middle, half, frequency, last, dtype, accuracy):
    r = middle + half * np.random.default_rng(0).uniform(-1, 1, 500)
    places, matrix = few_distances(r, max(frequency, last / r.min()), dtype)
    assert len(places) < 150
    n = np.arange(0, last + 1, 4)[:, None]
    j, y = (of_kind(n, frequency * r) for of_kind in (scipy.special.jv, scipy.special.yv))
    for of_kind, wanted in ((scipy.special.jv, j), (scipy.special.yv, y)):
        error = np.abs(of_kind(n, frequency * places) @ matrix - wanted).max(axis=1)
        # where n > lambda r, J decays, and is measured by itself
        size = np.where(n > frequency * r, np.abs(wanted), np.hypot(j, y))
        assert (error < accuracy * size.max(axis=1)).all()


def test_one_distance_and_few():
    places, matrix = few_distances(np.full(100, 1.3), 50.0, np.float64)
    assert len(places) < 12
    assert np.abs(np.cos(50 * places) @ matrix - np.cos(50 * 1.3)).max() < 1e-12
    distances = np.linspace(1.0, 1.6, 20)
    places, matrix = few_distances(distances, 50.0, np.float64)
    assert places is distances and matrix is None
