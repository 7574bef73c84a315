"""Numbers of waves, against the size of the terms that are left out, and groups of frequencies."""

from itertools import combinations, pairwise

import mpmath as mp
import numpy as np
import pytest
import scipy.special

from jaxtat.densities.cylindrical_waves import frequency_groups
from jaxtat.densities.cylindrical_waves.orders import TOLERANCE, highest_orders

FREQUENCIES = np.array([0.3, 1.0, 7.3, 40.0, 200.0, 700.0])


def term(n, lam, reach, distance):
    """|J_n(lambda reach) H_n(lambda distance)|, with 30 digits and no underflow."""
    with mp.workdps(30):
        x, z = mp.mpf(float(lam)) * reach, mp.mpf(float(lam)) * distance
        return abs(mp.besselj(int(n), x)) * abs(mp.hankel1(int(n), z))


def least_order(lam, reach, distance):
    """The last n whose term is not below the tolerance; beyond lambda reach terms only fall."""
    n = np.arange(int(lam * distance) + 2)
    j, h = scipy.special.jv(n, lam * reach), scipy.special.hankel1(n, lam * distance)
    bound = TOLERANCE * np.abs(j * h).max()
    low, high = int(lam * reach), int(lam * distance) + 20_000
    while high - low > 1:
        middle = (low + high) // 2
        if term(middle, lam, reach, distance) >= bound:
            low = middle
        else:
            high = middle
    return low


@pytest.mark.parametrize("ratio", [0.3, 0.9])
def test_what_is_left_out_is_below_the_tolerance_and_little_is_wasted(ratio):
    """N is at least, and at most 15 % or 12 orders above, the least that brute force finds."""
    distance = 1.3
    found = highest_orders(FREQUENCIES, ratio * distance, distance)
    least = [least_order(lam, ratio * distance, distance) for lam in FREQUENCIES]
    assert (found >= least).all()
    assert (found <= np.maximum(np.array(least) * 1.15, np.array(least) + 12)).all()


def test_the_unit_of_length_does_not_matter():
    found = highest_orders(FREQUENCIES, 1.0, 1.3)
    for unit in (1e-3, 37.0):
        assert np.array_equal(highest_orders(FREQUENCIES / unit, unit, 1.3 * unit), found)


def test_close_detectors_need_orders_beyond_the_first_guess():
    """A ratio of 0.99 takes thousands of orders at low frequencies, and they are found."""
    (found,) = highest_orders(np.array([1.0]), 0.99, 1.0)
    assert found > 1800
    bound = TOLERANCE * term(0, 1.0, 0.99, 1.0)
    assert term(found + 1, 1.0, 0.99, 1.0) < bound < term(found - 200, 1.0, 0.99, 1.0)


@pytest.mark.parametrize(("n", "most", "n_groups"), [(1, 6, 1), (4, 6, 4), (7, 3, 3), (129, 6, 6)])
def test_groups_hold_every_frequency_once_with_orders_enough(n, most, n_groups):
    orders = np.random.default_rng(n).integers(600, 3000, n)
    groups = frequency_groups(orders, most)
    assert len(groups) == n_groups
    assert np.array_equal(np.concatenate([np.arange(n)[part] for part, _ in groups]), np.arange(n))
    for part, needed in groups:
        assert part.stop > part.start and needed == orders[part].max()


def test_no_other_groups_are_less_work():
    orders = np.sort(np.random.default_rng(0).integers(600, 3000, 9))

    def work(bounds):
        return sum((b - a) * int(orders[b - 1]) ** 3 for a, b in pairwise([0, *bounds, 9]))

    groups = frequency_groups(orders, 4)
    assert work([part.stop for part, _ in groups[:-1]]) == min(
        map(work, combinations(range(1, 9), 3))
    )


def test_small_problems_are_not_worth_a_second_program():
    assert len(frequency_groups(np.full(32, 130), 6)) == 1
    assert len(frequency_groups(np.full(64, 150), 6)) == 2
