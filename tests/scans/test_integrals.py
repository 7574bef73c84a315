"""Circular integrals in a file: fitted, with negative pixels only where integrals are negative."""

import jax
import numpy as np
import pytest

from jaxtat import circular_arc, data_radii, disk, phantoms
from jaxtat.io import Scan
from jaxtat.scans import choose, reconstruct, with_best_method

CURVE = circular_arc(1.3, 1.0, 64)
RADII = data_radii(CURVE, disk(1.0), 1 / 16)
DISKS = phantoms.Disks([[0.2, 0.1], [-0.4, -0.2]], [0.3, 0.25])
SIGNED = phantoms.Disks([[0.2, 0.1], [-0.4, -0.2]], [0.3, 0.25], [1.0, -0.7])


def scan_of(phantom, noise=0.0):
    g = phantom.circular_integrals(CURVE, RADII)
    g = g + phantoms.noise_like(jax.random.key(0), g, noise) if noise else g
    known = {"detectors": CURVE.points, "radii": RADII}
    return Scan("circular_integrals", np.asarray(g), {k: np.asarray(v) for k, v in known.items()})


def error(found, phantom):
    inside = np.asarray(found.region.contains(found.grid.points))
    fine = found.grid.finer(3)
    wanted = np.asarray(found.grid.means(phantom(fine.points)))[inside]
    return np.linalg.norm(found.image[inside] - wanted) / np.linalg.norm(wanted)


@pytest.mark.parametrize("phantom", [DISKS, SIGNED], ids=["positive", "signed"])
def test_integrals_with_noise_are_fitted_and_nearer_than_the_formula(phantom):
    scan = scan_of(phantom, 0.05)
    direct = choose(scan, region_radius=1.0, pixels=33)
    best = with_best_method(scan, direct)
    assert best.model_based and best.nonnegative == (phantom is DISKS)
    found = reconstruct(scan, best)
    assert (found.image.min() < -0.3) == (phantom is SIGNED)
    assert error(found, phantom) < 0.5 * error(reconstruct(scan, direct), phantom)


def test_who_asks_for_the_formula_gets_it():
    scan = scan_of(DISKS)
    for asked in ({"model_based": False}, {"alpha": 1e-4}, {"low_pass": "cosine"}):
        assert not with_best_method(scan, choose(scan, region_radius=1.0, **asked)).model_based


def test_a_given_penalty_allows_negative_pixels_as_the_default_does():
    for phantom in (DISKS, SIGNED):
        scan = scan_of(phantom)
        chosen = choose(scan, region_radius=1.0, penalty="tv")
        assert chosen.nonnegative == with_best_method(scan, choose(scan)).nonnegative
        assert chosen.nonnegative == (phantom is DISKS)
