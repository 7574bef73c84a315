"""J_n and Y_n order by order against scipy, and in the scaled range against mpmath."""

import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
import scipy.special

from jaxtat.special import (
    decay_steps,
    full_circle_norm,
    hankel_rows,
    known_circle_norm,
    known_decay_steps,
)

mp.mp.dps = 30


def test_steps_are_those_of_the_compiled_sequence():
    x = np.array([0.5, 3.0, 41.7, 300.0])
    steps = known_decay_steps(250, x)
    assert np.allclose(steps, decay_steps(250, jnp.asarray(x)), rtol=1e-13, atol=0)
    assert (steps[:3, 1] == 1).all() and (steps[4:, 1] < 1).all() and (steps[:, 3] == 1).all()


@pytest.mark.parametrize("reach", [0.3, 30.0, 300.0])
def test_all_orders_of_scipy(reach):
    """Orders below, between and above the arguments of one row."""
    x = reach * np.array([[1.0, 1.2, 3.0], [1.1, 2.0, 5.0]])
    steps = known_decay_steps(120, 0.9 * x[:, 0])
    scale, order = np.cumprod(steps, axis=0)[..., None], np.arange(121)[:, None, None]
    j, y = map(np.stack, zip(*hankel_rows(x, steps), strict=True))
    wanted_j, wanted_y = scipy.special.jv(order, x), scipy.special.yv(order, x)
    size = np.hypot(wanted_j, wanted_y)
    above = order > x  # where J decays
    assert np.abs(np.where(above, 1, wanted_j) - np.where(above, 1, j * scale)).max() < 1e-12
    known = above & (np.abs(wanted_j) > 1e-280)
    assert np.abs(j * scale / np.where(known, wanted_j, 1) - 1)[known].max(initial=0) < 1e-11
    known = np.isfinite(wanted_y)
    assert (np.abs(y / scale - wanted_y)[known] < 1e-11 * size[known]).all()


def test_products_of_orders_that_under_and_overflow():
    x = np.array([[2.0, 2.6]])
    *_, (j, y) = hankel_rows(x, known_decay_steps(500, x[:, 0]))
    wanted = mp.besselj(500, 2.0) * mp.bessely(500, 2.6)
    assert abs(j[0, 0] * y[0, 1] / float(wanted) - 1) < 1e-12


def test_rows_that_need_no_more_are_left_out():
    x = np.array([[0.5, 0.7], [9.0, 12.0], [60.0, 75.0], [300.0, 350.0]])
    needed = np.array([4, 20, 20, 90])
    steps = known_decay_steps(90, 0.9 * x[:, 0])
    every, some = list(hankel_rows(x, steps)), list(hankel_rows(x, steps, needed))
    assert [len(j) for j, _ in some] == [(needed >= n).sum() for n in range(91)]
    for n, (wanted, found) in enumerate(zip(every, some, strict=True)):
        for kind in range(2):
            assert np.allclose(found[kind], wanted[kind][needed >= n], rtol=1e-13, atol=0)


def test_norms_are_those_of_the_compiled_sum():
    frequency = np.array([0.01, 0.5, 3.0, 40.0, 200.0])
    for n_orders in (None, 400):  # at the lowest frequency Y of most of these overflows
        found = known_circle_norm(frequency, 1.3, n_orders)
        np.testing.assert_allclose(found, full_circle_norm(frequency, 1.3, n_orders), rtol=1e-14)
