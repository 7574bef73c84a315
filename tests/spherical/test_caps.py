"""Caps, regions and sizes: quadrature, meridian sections, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxtat
from jaxtat import AccuracyWarning, Setup, VisibilityWarning, VolumeGrid
from jaxtat.geometry.balls import enough_boundary
from jaxtat.spherical import DetectorPoints, ball, cap_radii, find_rings, spherical_cap
from jaxtat.spherical.sizes import resolved_frequency
from jaxtat.spherical.visible import missed_share


@pytest.mark.parametrize(("rule", "order"), [("gauss", 13), ("equal", 2)])
def test_weights_integrate_over_the_cap(rule, order):
    """∫ z_3² dS and ∫ z_1² dS of |z| = 2, z_3 < 1, to the order of the rule."""
    errors = []
    for n in (8, 16):
        cap = spherical_cap(2.0, 1.0, n, 16, center=(0.1, 0.2, 0.3), rule=rule)
        local = np.asarray(cap.points) - np.array([0.1, 0.2, 0.3])
        assert np.allclose(np.linalg.norm(local, axis=-1), 2.0) and local[..., 2].max() < 1.0
        assert np.all(np.diff(local[:, 0, 2]) > 0) and np.allclose(local[:, 0, 1], 0.0)
        weights = np.asarray(cap.weights)
        np.testing.assert_allclose(weights.sum(), 2 * np.pi * 2 * 3.0, rtol=1e-13)
        third = 4 * np.pi * (1 + 8) / 3
        first = (2 * np.pi * 2 * 3.0 * 4 - third) / 2
        found = [(weights * local[..., k] ** 2).sum() for k in (2, 0)]
        errors.append(np.abs(np.subtract(found, [third, first])))
    assert (errors[1] < np.maximum(1e-12, 1.2 * errors[0] / 2**order)).all()


def test_the_meridian_section_is_the_paper_geometry():
    """Rings lie on the arc, and what is seen at which distances is as in the plane."""
    cap, region = spherical_cap(1.3, 1.0, 32, 64), ball(1.0)
    arc = cap.meridian
    assert np.isclose(np.asarray(arc.points)[:, 0].max(), 1.0, atol=0.05)
    assert np.allclose(np.linalg.norm(np.asarray(arc.points), axis=1), 1.3)
    radii = cap_radii(cap, region, 1 / 16)
    flat = jaxtat.data_radii(arc, region.meridian, 1 / 16)
    np.testing.assert_array_equal(radii, flat)
    points = DetectorPoints(np.asarray(cap.points).reshape(-1, 3))
    near = np.linalg.norm(np.asarray(points.meridian.points), axis=1)
    assert np.allclose(near, 1.3) and points.meridian.n_detectors == 2 * 32 * 64


def test_boundary_of_a_cut_ball_integrates_exactly():
    """Area, ∫ x_3 dS and the divergence theorem for the field (0, 0, x_3)."""
    radius, top = 1.5, 0.4
    edge = ball(radius, top).boundary((36, 24))
    x3, flat = np.asarray(edge.distance * edge.cosine), np.asarray(edge.flat)
    weights = np.asarray(edge.weights)
    curved, disk = 2 * np.pi * radius * (top + radius), np.pi * (radius**2 - top**2)
    np.testing.assert_allclose(weights.sum(), curved + disk, rtol=1e-12)
    np.testing.assert_allclose(weights[flat > 0].sum(), disk, rtol=1e-12)
    normal3 = np.where(flat > 0, 1.0, np.asarray(edge.cosine))
    volume = np.pi * (2 * radius**3 / 3 + radius**2 * top - top**3 / 3)
    np.testing.assert_allclose((weights * normal3 * x3).sum(), volume, rtol=1e-12)


SOME = 1.5 * np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


def problem(**changes):
    given = {
        "curve": spherical_cap(1.5, 1.1, 24, 48),
        "region": ball(1.0),
        "grid": VolumeGrid(13),
        "radii": 0.5 + 0.1 * np.arange(21),
    }
    return Setup(**(given | changes))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: spherical_cap(1.3, -1.4, 8, 16), "is empty"),
        (lambda: spherical_cap(1.3, 1.0, 8, 15), "even number"),
        (lambda: spherical_cap(1.3, 1.0, 1, 16), "n_rings is 1"),
        (lambda: spherical_cap(1.3, 1.0, 8, 16, rule="lobatto"), "rule is 'lobatto'"),
        (lambda: spherical_cap(-1.3, 1.0, 8, 16), "radius is"),
        (lambda: ball(1.0, 1.0), "cut is 1.0"),
        (lambda: DetectorPoints(np.zeros((3, 2))), r"expected \(detectors, 3\)"),
        (lambda: DetectorPoints(np.ones((2, 3)), [1.0, -1.0]), "weights is"),
        (lambda: problem(region=ball(1.0, center=(0.1, 0, 0))), "same center"),
        (lambda: problem(curve=spherical_cap(0.9, 0.7, 24, 48)), "are not outside of the region"),
        (lambda: problem(curve=spherical_cap(1.005, 1.0, 24, 48)), "are not outside of the region"),
        (lambda: problem(radii=3.5 + 0.1 * np.arange(12)), "radii run from"),
        (lambda: problem(grid=VolumeGrid(13, 1.0, (5.0, 0.0, 0.0))), "no node of the grid"),
        # inside the ball, and so is the corner of the grid's box, but above the cut
        (
            lambda: problem(
                region=ball(1.0, 0.0),
                grid=VolumeGrid(5, 0.2, (0, 0, 0.6)),
                max_frequency=9,
            ),
            "no node of the grid",
        ),
        (
            lambda: problem(curve=DetectorPoints(SOME), region=ball(1.0, 0.0)),
            "needs detectors on rings",
        ),
        (lambda: VolumeGrid((4, 4)), "expected a number or 3"),
    ],
)
def test_what_cannot_work_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_warnings_of_sampling_and_visibility():
    with pytest.warns(AccuracyWarning, match=r"pass max_frequency=\d"):
        problem(curve=spherical_cap(1.5, 1.1, 24, 20))
    with pytest.warns(VisibilityWarning, match="in a meridian plane"):
        problem(curve=spherical_cap(1.5, 0.5, 24, 48))


def test_a_bowl_without_a_bottom_is_flagged_and_keeps_its_frequencies():
    """Rings .036 apart with a hole of 1.9 rad below: the hole is not their spacing."""
    theta, phi = np.linspace(2.2, 0.8, 40)[:, None], 2 * np.pi / 96 * np.arange(96)
    parts = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi
    rings = find_rings(1.5 * np.stack(parts, axis=-1).reshape(-1, 3)).rings
    with pytest.warns(VisibilityWarning, match="in a meridian plane 3") as caught:
        problem(curve=rings, region=ball(0.9))
    assert len(caught) == 1  # and none of sampling
    step = 1.4 / 39
    assert np.isclose(resolved_frequency(rings, 0.5), 96)  # by azimuths; by the hole 3.6
    weights = np.asarray(rings.meridian.weights)
    np.testing.assert_allclose(weights, 1.5 * step)
    # down to the pole the lowest ring stands for what is below it, and its distance counts
    down = find_rings(
        np.asarray(spherical_cap(1.5, 1.1, 24, 48, rule="equal").points).reshape(-1, 3)
    )
    assert np.isclose(down.rings.lowest_angle, np.pi)
    problem(curve=down.rings, max_frequency=20.0)


def spiral(n):
    """n detectors evenly over a sphere."""
    k = np.arange(n) + 0.5
    turn, height = np.pi * (1 + 5**0.5) * k, 1 - 2 * k / n
    ring = np.sqrt(1 - height**2)
    return 1.5 * np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)


def test_too_few_points_are_flagged_with_how_many_are_needed():
    """Of waves up to degree l there are (l + 1)², here 100 within lambda R = 9."""
    problem(curve=DetectorPoints(spiral(110)), max_frequency=9.0)
    with pytest.warns(AccuracyWarning, match="too few: .*here are 30, and 100 are needed"):
        problem(curve=DetectorPoints(spiral(30)), max_frequency=9.0)


def test_points_that_see_half_of_the_lines_are_flagged():
    rng = np.random.default_rng(0)
    unit = rng.standard_normal((120, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    problem(curve=DetectorPoints(1.5 * unit), max_frequency=9.0)
    unit[:, 2] = -abs(unit[:, 2])
    with pytest.warns(VisibilityWarning, match=r"% of the lines .* miss the detectors"):
        problem(curve=DetectorPoints(1.5 * unit), max_frequency=9.0)
    assert missed_share(DetectorPoints([[0.0, 0.0, -1.5]]), ball(0.01)) == 1.0  # all around none


@pytest.mark.parametrize("height", [0.3, 0.7, 1.0, 1.3])
def test_the_share_of_lines_that_miss_scattered_points_is_that_of_the_cap(height):
    """Beside random lines through the ball that leave the sphere above the cap at both ends."""
    n, rng = 400, np.random.default_rng(0)
    z, turn = -1 + height * (np.arange(n) + 0.5) / n, np.pi * (3 - np.sqrt(5)) * np.arange(n)
    ring = np.sqrt(1 - z**2)
    points = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    along = rng.standard_normal((200_000, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    within = rng.uniform(-1, 1, (200_000, 3))
    feet = 0.4 * (within - np.sum(within * along, axis=1, keepdims=True) * along)
    near = np.linalg.norm(feet, axis=1) < 0.4
    half = np.sqrt(1 - np.sum(feet**2, axis=1))
    ends = [(feet + sign * half[:, None] * along)[near, 2] > height - 1 for sign in (1, -1)]
    exact = np.mean(ends[0] & ends[1])
    assert missed_share(DetectorPoints(points), ball(0.4)) == pytest.approx(exact, abs=0.03)


def test_boundary_points_suffice_wherever_the_ball_is_cut():
    """As many as the quadrature needs on each part, and hardly more; chosen by the setup."""
    for top in (-0.7, -0.2, 0.0, 0.3, 0.9):
        curved, flat = enough_boundary(1.0, top, 40.0)
        angle = np.pi - np.arccos(top)
        assert curved >= 20 * angle + 8 and flat >= 20 * np.sin(angle) + 8
        assert curved + flat < 20 * max(5 / 3 * angle, 5 / 2 * np.sin(angle)) + 24
    setup = problem(region=ball(1.0, 0.3), max_frequency=9.0)
    assert setup.sizes.boundary == enough_boundary(1.0, 0.3, 9.0)
    assert problem(max_frequency=9.0).sizes.boundary is None


def test_a_setup_can_be_made_inside_jit_of_a_known_geometry():
    where = spherical_cap(1.5, 1.1, 24, 48), ball(1.0), VolumeGrid(13), 0.5 + 0.1 * np.arange(21)
    found = jax.jit(lambda g: g * Setup(*where).sizes.max_frequency)(1.0)
    assert float(found) == Setup(*where).sizes.max_frequency


def test_sizes_cover_every_degree_of_every_order():
    """Sizes are at least N + 1 - m for the first m of a piece, and never more than the largest."""
    for n, rings, azimuths in ((13, 24, 48), (65, 96, 256), (129, 192, 512)):
        cap, region = spherical_cap(1.3, 1.0, rings, azimuths), ball(1.0)
        sizes = Setup(cap, region, VolumeGrid(n), cap_radii(cap, region, 1 / (n - 1))).sizes
        assert sizes.n_orders == min(azimuths // 2, sizes.groups[-1] + 1)
        assert sizes.n_pieces * sizes.piece >= sizes.n_orders
        np.testing.assert_allclose(sizes.frequencies[-1], np.pi * (n - 1) / 2)
        assert sizes.frequency_step <= np.pi / 2 * (1 + 1e-12)
        distinct = {size for row in sizes.degrees for size in row if size}
        assert len(distinct) <= sizes.n_sizes and max(distinct) == sizes.groups[-1] + 1
        for l_max, row in zip(sizes.groups, sizes.degrees, strict=True):
            for piece, size in enumerate(row):
                needed = l_max + 1 - piece * sizes.piece
                assert size >= needed if needed > 0 else size == 0
                assert size + piece * sizes.piece + sizes.piece <= (
                    sizes.groups[-1] + 1 + sizes.n_pieces * sizes.piece
                )


def test_grids_under_jit_and_points_keep_their_types():
    grid = VolumeGrid(5)
    moved = jax.jit(lambda c: VolumeGrid(5, 1.0, c).points)(jnp.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(moved[..., 0], grid.points[..., 0] + 1)
