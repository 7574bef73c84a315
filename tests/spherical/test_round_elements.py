"""Round elements of finite size in space."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special

from jaxtat import Setup, VolumeGrid, forward_operator, solve
from jaxtat.geometry.elements import across, round_factor
from jaxtat.phantoms.space import SolidBells
from jaxtat.spherical import DetectorPoints, ball, spherical_cap

BELL = SolidBells([[0.4, 0.0, -0.2]], [0.55])
WIDE = 0.3  # of a ball of radius 1


def scattered(element_radius, n=140):
    """Points in several distances on a spiral around the ball, each with its own size if given."""
    height = np.linspace(-0.99, 0.99, n)
    turn, ring = 2.4 * np.arange(n), np.sqrt(1 - height**2)
    units = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)
    distance = 1.4 + 0.2 * np.sin(np.arange(n))
    sizes = None if element_radius is None else element_radius * np.linspace(0.5, 1, n)
    return DetectorPoints(units * distance[:, None], element_radius=sizes)


def on_rings(element_radius):
    return spherical_cap(1.5, 1.1, 12, 24, element_radius=element_radius)


def setup_of(curve):
    return Setup(curve, ball(1.0), VolumeGrid(17), max_frequency=10.0)


TILT = np.radians(30)


def tilted(n=24):
    """Few of the scattered ones, as flat disks turned by 30 degrees from the centre."""
    every = scattered(WIDE)
    points, radius = np.asarray(every.points)[::6][:n], np.asarray(every.element_radius)[::6][:n]
    outward = points / np.linalg.norm(points, axis=1, keepdims=True)
    normals = np.cos(TILT) * outward + np.sin(TILT) * np.asarray(across(jnp.asarray(outward))[0])
    return DetectorPoints(points, element_radius=radius, normals=2 * normals)


def summed_over(curve, radii, nodes, weights):
    """Brute force: exact integrals about points of elements, in steps along two sides [radius]."""
    first, second = (np.asarray(v) for v in across(curve.normals))
    total = 0.0
    for (x, y), weight in zip(nodes, weights, strict=True):
        sides = np.asarray(curve.element_radius)[:, None]
        at = DetectorPoints(np.asarray(curve.points) + sides * (x * first + y * second))
        total = total + weight * np.asarray(BELL.spherical_integrals(at, radii))
    return total


def on_square(n=5):
    """Gauss's nodes of a square of the second moment of a disk of radius 1."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    half = np.sqrt(3) / 2
    places = [(half * x, half * y) for x in nodes for y in nodes]
    return places, np.outer(weights, weights).ravel() / 4


def on_disk(n=14):
    """Midpoints of a square lattice that lie in a disk of radius 1, which need no rule."""
    steps = (np.arange(n) + 0.5) / n * 2 - 1
    places = [(x, y) for x in steps for y in steps if x**2 + y**2 < 1]
    return places, np.full(len(places), 1 / len(places))


@pytest.mark.slow
def test_flat_elements_record_means_over_disks_that_face_elsewhere():
    """And over squares that face there, up to a twentieth of what turning them makes."""
    setup = Setup(tilted(), ball(1.0), VolumeGrid(25), max_frequency=3.8)
    operator = forward_operator(setup)
    found = np.asarray(operator.mv(BELL.volume(setup.grid)))
    curve, radii = setup.curve, setup.radii
    facing = DetectorPoints(curve.points, element_radius=curve.element_radius)
    effect = np.abs(np.asarray(BELL.spherical_integrals(facing, radii)) - found).max()
    for places in (on_disk(), on_square()):
        off = np.abs(found - summed_over(curve, radii, *places)).max()
        assert off < 0.05 * effect
    own = np.asarray(BELL.spherical_integrals(curve, radii))
    assert np.abs(found - own).max() < 0.05 * effect and effect > 0.02 * found.max()
    rng = np.random.default_rng(3)
    volume, data = rng.normal(size=setup.grid.shape), rng.normal(size=found.shape)
    there, back = operator.mv(volume), operator.T.mv(data)
    size = np.linalg.norm(there) * np.linalg.norm(data)
    assert abs(np.vdot(there, data) - np.vdot(volume, back)) < 1e-12 * size
    with pytest.raises(ValueError, match="elements have normals: fit the volume"):
        solve(setup, found, 1e-6)


@pytest.fixture(scope="module", params=[on_rings, scattered])
def both(request):
    """The same problem of wide elements and of points, and exact data of each."""
    setups = setup_of(request.param(WIDE)), setup_of(request.param(None))
    return [(one, BELL.spherical_integrals(one.curve, one.radii)) for one in setups]


@pytest.mark.parametrize("angle", [0.02, 0.3, 1.0])
def test_the_factor_is_that_of_the_closed_form(angle):
    degree = np.arange(1, 30)
    p = scipy.special.eval_legendre
    closed = (p(degree - 1, np.cos(angle)) - p(degree + 1, np.cos(angle))) / (
        (2 * degree + 1) * (1 - np.cos(angle))
    )
    factor = jax.jit(round_factor, static_argnums=(0, 2))(30, angle, 20)
    np.testing.assert_allclose(factor[0], 1, atol=1e-14)
    np.testing.assert_allclose(factor[1:], closed, atol=1e-11)  # the closed form cancels


@pytest.mark.parametrize("turn", [0.0, 0.6])
def test_squares_record_what_disks_of_the_same_second_moment_do(turn):
    """Squares of the sphere, of any rotation, by brute force; far nearer than their middles."""
    units = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [-0.6, 0.48, 0.64]])
    width, radii = 0.25, jnp.linspace(0.8, 2.2, 57)
    nodes, weights = np.polynomial.legendre.leggauss(6)
    first, second = (np.asarray(v) for v in across(jnp.asarray(units)))
    along = np.cos(turn) * first + np.sin(turn) * second
    aside = np.cos(turn) * second - np.sin(turn) * first
    offsets = [width / 2 * (x * along + y * aside) for x in nodes for y in nodes]
    middles = 1.5 * units
    on_sphere = np.concatenate([middles, *(middles + s for s in offsets)])
    points = DetectorPoints(1.5 * on_sphere / np.linalg.norm(on_sphere, axis=1, keepdims=True))
    g = np.asarray(BELL.spherical_integrals(points, radii)).reshape(37, 4, -1)
    squares = np.tensordot(np.outer(weights, weights).ravel() / 4, g[1:], 1)
    of_size = DetectorPoints(middles, element_size=width)
    off = np.abs(np.asarray(BELL.spherical_integrals(of_size, radii)) - squares).max()
    assert off < 2e-3 * squares.max() and off < np.abs(g[0] - squares).max() / 10


def test_square_elements_have_the_radius_of_their_second_moment():
    """(1/w²) ∫ x² over a square of the side w and (1/πa²) ∫ x² over a disk: w²/12 = a²/4."""
    sizes = np.linspace(0.1, 0.3, 5)
    points = DetectorPoints(1.5 * np.ones((5, 3)), element_size=sizes, normals=np.ones((5, 3)))
    np.testing.assert_allclose(np.asarray(points.element_radius) ** 2 / 4, sizes**2 / 12)
    cap = spherical_cap(1.5, 1.1, 12, 24, element_size=0.2)
    assert float(cap.element_radius) == pytest.approx(np.sqrt(0.2**2 / 3), rel=1e-14)


def test_data_are_means_over_the_elements(both):
    """Against exact means, and far from what points record."""
    (wide, g), (_, points) = both
    setup = Setup(wide.curve, wide.region, VolumeGrid(25), wide.radii, max_frequency=10.0)
    operator = forward_operator(setup)
    found = operator.mv(BELL.volume(setup.grid))
    error, effect = (np.abs(data - g).max() / g.max() for data in (found, points))
    assert error < 0.05 * effect
    assert effect > 0.03
    rng = np.random.default_rng(3)
    volume, data = rng.normal(size=setup.grid.shape), rng.normal(size=g.shape)
    there, back = operator.mv(volume), operator.T.mv(data)
    size = np.linalg.norm(there) * np.linalg.norm(data)
    assert abs(np.vdot(there, data) - np.vdot(volume, back)) < 1e-12 * size


@pytest.mark.slow
def test_images_know_of_the_elements(both):
    """Images of wide elements are those of points; taken for points they are blurred."""
    (wide, g), (points, of_points) = both
    exact, with_model, without = (
        np.asarray(solve(*given, 1e-6).image)
        for given in ((points, of_points), (wide, g), (points, g))
    )
    blur = abs(without - exact).max()
    assert abs(with_model - exact).max() < 0.25 * blur
    assert blur > 0.02


def test_derivatives_of_data_in_the_size(check_both_modes):
    """Both modes against central differences. Of images: test_reconstruction.py."""
    setup = setup_of(scattered(WIDE))
    curve, volume = setup.curve, BELL.volume(setup.grid)
    g = BELL.spherical_integrals(curve, setup.radii)

    def energy(scale):
        where = curve.points, curve.weights, curve.center
        sized = DetectorPoints(*where, element_radius=scale * curve.element_radius)
        operator = forward_operator(setup.replace(curve=sized))
        return jnp.sum((operator.mv(volume) - 0.9 * g) ** 2)

    (slope,) = check_both_modes(energy, (1.0,), step=1e-4, rtol=1e-6, atol=0)
    assert abs(slope) > 1e-4


def test_refusals():
    with pytest.raises(ValueError, match=r"element_radius is -0\.1, expected"):
        spherical_cap(1.5, 1.1, 12, 24, element_radius=-0.1)
    with pytest.raises(ValueError, match="element_radius is 3, expected a length"):
        spherical_cap(1.5, 1.1, 12, 24, element_radius=3.0)
    with pytest.raises(
        ValueError, match=r"shape \(2,\), expected one number, or one for each of 3"
    ):
        DetectorPoints(np.eye(3), element_radius=[0.1, 0.2])
    with pytest.raises(ValueError, match=r"element_size is 1\.6, expected a length"):
        spherical_cap(1.5, 1.1, 12, 24, element_size=1.6)
    with pytest.raises(ValueError, match="element_radius and element_size are both given"):
        DetectorPoints(np.eye(3), element_radius=0.1, element_size=0.1)
    with pytest.raises(ValueError, match="normals are given without element_radius"):
        DetectorPoints(np.eye(3), normals=np.eye(3))
    with pytest.raises(ValueError, match="normal 1 is zero, expected a direction"):
        DetectorPoints(np.eye(3), element_radius=0.1, normals=[[0, 0, 1], [0, 0, 0], [1, 0, 0]])
    with pytest.raises(ValueError, match="of other sizes"):
        setup_of(on_rings(WIDE)).replace(curve=on_rings(None))
