"""About which centre and axis waves are taken, and which symmetry is seen."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import circular_arc, detector_curve, disk
from jaxtat.densities.cylindrical_waves import polar_geometry, wave_orders
from jaxtat.geometry.curves import SampledCurve

PLACE = {"center": (2.0, -1.0), "angle": 2.3}


@eqx.filter_jit
def positions(polar):
    """Detectors, back from polar coordinates."""
    angles = polar.detector_angles + polar.axis
    unit = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1)
    return polar.center + jnp.reshape(polar.detector_radius, (-1, 1)) * unit


def kind(polar):
    return polar.mirror, polar.disk, polar.on_circle


@pytest.mark.parametrize(("n", "right"), [(40, 1.0), (41, 0.0)])
@pytest.mark.parametrize("measured", [False, True])
def test_arcs_anywhere(n, right, measured):
    """Known as an arc or by its points, an arc is on its circle and mirrored about its middle."""
    arc, region = circular_arc(1.3, right, n, **PLACE), disk(1.0, right, n_boundary=80, **PLACE)
    polar = polar_geometry(detector_curve(arc.points) if measured else arc, region)
    assert kind(polar) == (True, right == 1.0, True)
    np.testing.assert_allclose(positions(polar), arc.points, atol=1e-12)
    np.testing.assert_allclose(polar.weights, arc.weights, rtol=1e-9)
    np.testing.assert_allclose(polar.center, PLACE["center"], atol=1e-12)
    np.testing.assert_allclose(polar.detector_radius, 1.3, rtol=1e-12)
    assert np.isclose(np.cos(polar.axis - 2.3), -1.0)
    np.testing.assert_allclose(polar.detector_angles, -polar.detector_angles[::-1], atol=1e-12)


def test_half_of_a_mirrored_geometry_stands_for_all():
    """Sums of even functions over one side, twice weighted, are those over both sides."""
    region = disk(1.0, 0.0, n_boundary=80, **PLACE)
    for n in (40, 41):
        polar = polar_geometry(circular_arc(1.3, 0.0, n, **PLACE), region)
        half = polar.one_side()
        whole_sum = np.sum(polar.weights * np.cos(3 * np.asarray(polar.detector_angles)))
        half_sum = np.sum(half.weights * np.cos(3 * np.asarray(half.detector_angles)))
        np.testing.assert_allclose(half_sum, whole_sum, rtol=1e-12)
        assert half.detector_angles.shape == (-(-n // 2),)
    assert polar.region.points.shape == (40, 2)
    whole, half = (
        (np.asarray(part.weights), np.asarray(part.points) - np.asarray(polar.center))
        for part in (region, polar.region)
    )
    for power in (0, 3):
        sums = [np.sum(w * np.linalg.norm(x, axis=1) ** power) for w, x in (whole, half)]
        np.testing.assert_allclose(*sums, rtol=1e-12)


@pytest.mark.parametrize("n", range(822, 826))
def test_boundary_points_that_a_setup_chooses_leave_the_symmetry(n):
    """With a point on the axis, as an odd number had, systems would be twice as large."""
    region = disk(1.0, 0.0)
    region = region.with_counts(region.shared_out(n))
    assert n <= region.n_boundary <= n + 1
    polar = polar_geometry(circular_arc(1.3, 0.0, 41), region)
    assert polar.mirror and polar.rim == region.counts[0] // 2


def test_broken_symmetry_is_seen():
    """A moved detector, another weight, a turned region, one off the axis: no mirror is used."""
    arc = circular_arc(1.3, 0.0, 40, **PLACE)
    half = disk(1.0, 0.0, n_boundary=80, **PLACE)
    whole = disk(0.9, n_boundary=80, **PLACE)
    askew = disk(1.0, 0.0, n_boundary=80, center=PLACE["center"], angle=2.4)
    assert kind(polar_geometry(arc, askew)) == (False, False, True)
    off_axis = disk(0.9, n_boundary=80, center=(2.05, -1.0))
    assert kind(polar_geometry(arc, off_axis)) == (False, False, True)
    along = 0.1 * np.array([np.cos(2.3), np.sin(2.3)])
    shifted = disk(0.9, n_boundary=80, center=np.array(PLACE["center"]) + along, angle=2.3)
    assert kind(polar_geometry(arc, shifted)) == (True, False, True)
    moved = detector_curve(arc.points.at[3].add(1e-5))
    assert kind(polar_geometry(moved, whole)) == (False, True, False)
    assert kind(polar_geometry(moved, half)) == (False, False, False)
    uneven = SampledCurve(arc.points, arc.weights.at[3].multiply(1.001), arc.normals, False)
    assert kind(polar_geometry(uneven, whole)) == (False, True, True)


def test_a_straight_line_of_detectors():
    """Without a circle waves are about the centre of the region; the line is mirrored."""
    x = jnp.linspace(-2.0, 2.0, 21)
    curve = detector_curve(jnp.stack([jnp.full(21, -1.5), x], axis=1))
    polar = polar_geometry(curve, disk(1.0, n_boundary=80))
    assert kind(polar) == (True, True, False)
    np.testing.assert_allclose(positions(polar), curve.points, atol=1e-12)


CENTRED = (0.0, 0.0)  # of waves about the centre of the region


def test_traced_parameters():
    """A traced radius leaves an arc what it is; traced positions are taken one by one."""
    region = disk(1.0, n_boundary=80, **PLACE)
    arc = circular_arc(1.3, 1.0, 40, **PLACE)
    seen = []

    def of_radius(radius):
        polar = polar_geometry(circular_arc(radius, 1.0, 40, **PLACE), region, offset=CENTRED)
        seen.append(kind(polar))
        return positions(polar)

    def of_positions(points):
        polar = polar_geometry(detector_curve(points, closed=False), region, offset=CENTRED)
        seen.append(kind(polar))
        return positions(polar)

    np.testing.assert_allclose(jax.jit(of_radius)(1.3), arc.points, atol=1e-12)
    found, slope = jax.jit(lambda at: (of_positions(at), jax.jacfwd(of_positions)(at)))(arc.points)
    np.testing.assert_allclose(found, arc.points, atol=1e-12)
    assert seen == [(True, True, True)] + 2 * [(False, True, False)]
    # positions are what they were given as, to first order too
    np.testing.assert_allclose(slope.reshape(80, 80), np.eye(80), atol=1e-12)


def test_halves_are_halves_only_where_no_derivative_moves_them():
    """Half a circle, and a chord through the centre: what is zero there has a derivative."""

    def halves(curve, region):
        polar = polar_geometry(curve, region, offset=CENTRED)
        return polar.half_turn, polar.halved

    def arc(cut):
        return circular_arc(1.3, cut, 40)

    def part(cut):
        return disk(1.0, cut, n_boundary=80)

    half_arc, half_disk = arc(0.0), part(0.0)
    seen = [halves(half_arc, half_disk), halves(half_arc, part(1e-9)), halves(arc(1e-9), half_disk)]

    def traced(number):
        seen.extend([halves(arc(number), half_disk), halves(half_arc, part(number))])
        return number

    jax.make_jaxpr(traced)(0.0)
    assert seen == [(True, True), (True, False), (False, True), (False, True), (True, False)]


def test_reach_and_detectors_too_near():
    arc = circular_arc(1.3, 1.3, 40, **PLACE)
    concentric = disk(0.9, n_boundary=80, **PLACE)
    assert polar_geometry(arc, concentric).reach == 0.9
    off_centre = disk(0.9, n_boundary=400, center=(2.2, -1.0))
    np.testing.assert_allclose(polar_geometry(arc, off_centre).reach, 1.1, atol=1e-4)
    frequencies = np.array([1.0, 10.0])
    near, far = (wave_orders(polar_geometry(arc, r), frequencies) for r in (off_centre, concentric))
    assert (near > far).all()
    too_near = disk(1.1, n_boundary=80, center=(2.195, -1.0))
    with pytest.raises(ValueError, match="every detector farther off"):
        wave_orders(polar_geometry(arc, too_near), frequencies)
