"""Volumes from line detectors against exact ones, their adjoint, derivatives and files."""

import contextlib
import io
import re
from pathlib import Path
from types import SimpleNamespace

import equinox as eqx
import h5py
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import ImageGrid, VisibilityWarning, cosine_filter, disk
from jaxtat.line_detectors import (
    LineDetectorScan,
    PolynomialBalls,
    invert_projections,
    reconstruct,
    reconstruct_stack,
)

BELLS = PolynomialBalls([[0.2, 0.1, 0.1], [-0.2, -0.2, -0.1]], [0.7, 0.65], [1.0, -0.7], exponent=5)
HOW_TO = (Path(__file__).parents[2] / "docs/how-to/line_detectors.md").read_text()
DISK = disk(1.0, n_boundary=64)


def scan_of(n, whole=False, axis=0.0, first=0.0):
    return LineDetectorScan(first + np.arange(n) * ((2 if whole else 1) * np.pi / n), axis)


def projections_of(balls, scan, grid):
    """By the formula for the exponent 5: ∫ (1 - y²)^5 dy over -1 < y < 1 is 512/693."""
    points, axis = np.asarray(grid.points), float(scan.axis)
    parts = list(zip(*map(np.asarray, (balls.centers, balls.radii, balls.amplitudes)), strict=True))

    def at(angle):
        total = np.zeros(grid.shape)
        for (x, y, z), r, a in parts:
            center = [axis + x * np.cos(angle) + y * np.sin(angle), z]
            square = np.maximum(1 - np.sum((points - center) ** 2, -1) / r**2, 0)
            total += a * r * 512 / 693 * square**5.5
        return total

    return np.stack([at(angle) for angle in np.asarray(scan.angles)])


@pytest.fixture(scope="module")
def shown():
    """What the example of the how-to makes, run as it stands there."""
    (example,) = re.findall(r"test_volume.py -->\n```python\n(.*?)```", HOW_TO, flags=re.S)
    namespace, printed = {}, io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(example, namespace)
    return SimpleNamespace(**namespace, printed=printed.getvalue())


def test_volume_from_an_open_arc_is_exact(shown):
    exact = np.asarray(BELLS.volume(shown.plan.grid, shown.plan.grid.x2))
    assert np.abs(np.asarray(shown.volume) - exact).max() < 1e-4
    assert np.abs(exact).max() > 0.8
    assert 0 < float(shown.printed) < 1e-4


def test_low_pass_acts_on_all_directions_of_the_volume_alike(shown):
    """In space, f(x) = (1/2π²) ∫ eta F(lambda) sin(lambda |x|)/(lambda |x|) lambda² dlambda."""
    bell, scan = PolynomialBalls(np.zeros((2, 3)), [0.8, 0.8], [0.6, 0.4], exponent=5), shown.scan
    g = bell.circular_integrals(scan, shown.plan.curve, shown.plan.radii)
    found = np.asarray(reconstruct(shown.plan, g, scan, low_pass=cosine_filter))
    nodes, weights = np.polynomial.legendre.leggauss(400)
    t, last = 0.4 * (nodes + 1), float(shown.plan.frequencies[-1])
    lam, step = last * (nodes + 1) / 2, last / 2 * weights
    radial = 0.4 * weights * (1 - (t / 0.8) ** 2) ** 5 * t**2
    transform = 4 * np.pi * np.sinc(lam[:, None] * t / np.pi) @ radial
    filtered = transform * np.cos(np.pi / 2 * lam / last) * lam**2 * step / (2 * np.pi**2)
    some = slice(0, None, 4)  # heights
    grid, third = shown.plan.grid, np.asarray(shown.plan.grid.x2)[some]
    distance = np.sqrt((np.asarray(grid.points) ** 2).sum(-1)[..., None] + third**2)
    exact = np.sinc(distance[..., None] * lam / np.pi) @ filtered
    assert np.abs(exact - np.asarray(bell.volume(grid, jnp.asarray(third)))).max() > 1e-2
    assert np.abs(found[..., some] - exact)[distance < 0.9].max() < 3e-4


@pytest.mark.parametrize("inversion", ["fbp", "fourier"])
def test_slices_for_an_axis_anywhere_and_any_sizes(inversion):
    """An even number of nodes, an axis between two of them, another grid of slices, few heights."""
    grid, slices = ImageGrid((38, 5), (1.1, 0.4), (0.1, 0.1)), ImageGrid((9, 7), 0.8, (0.1, -0.1))
    scan = scan_of(48, axis=0.13, first=0.3)
    projections = projections_of(BELLS, scan, grid)
    found = invert_projections(
        projections,
        scan,
        grid,
        disk(1.0, n_boundary=64, center=(0.13, 0.0)),
        slices=slices,
        inversion=inversion,
    )
    assert found.shape == (9, 7, 5)
    assert np.abs(np.asarray(found) - BELLS.volume(slices, grid.x2)).max() < 1e-4


@pytest.mark.parametrize("edge", [0.0, 0.2])
def test_a_whole_turn_of_half_the_projections_is_enough(edge):
    """Lines beside the region, some of them seen from neither side, are not even looked at."""
    grid, scan = ImageGrid((33, 5), (1.0, 0.4)), scan_of(96, whole=True)
    region = disk(1.0, edge, n_boundary=64)
    inside = np.asarray(region.level(grid.points)) <= 1e-9
    projections = np.where(inside, projections_of(BELLS, scan, grid), np.pi)
    found = invert_projections(projections, scan, grid, region)
    assert 0.4 < inside.mean() < 0.7
    assert np.abs(np.asarray(found) - BELLS.volume(ImageGrid(33), grid.x2)).max() < 1e-4


def test_it_can_be_traced_with_the_plan_closed_over(shown):
    traced = jax.eval_shape(lambda g: reconstruct(shown.plan, g, shown.scan), shown.g)
    assert traced.shape == shown.volume.shape


def test_a_region_beside_the_axis_asks_for_a_whole_turn():
    grid, scan = ImageGrid((33, 5), (1.0, 0.4)), scan_of(96)
    with pytest.raises(VisibilityWarning, match="lie on one side of the axis u = 0 only"):
        invert_projections(np.zeros((96, 33, 5)), scan, grid, disk(1.0, 0.0, n_boundary=64))


def test_adjoint(shown):
    plan, scan, rng = shown.plan, shown.scan, np.random.default_rng(3)
    g, weights = rng.standard_normal(shown.g.shape), rng.standard_normal(shown.volume.shape)

    def volume(g):
        return reconstruct(plan, g, scan)

    found = volume(g)
    (adjoint,) = jax.linear_transpose(volume, jax.ShapeDtypeStruct(g.shape, g.dtype))(
        jax.device_put(weights)
    )
    assert np.isclose(np.vdot(found, weights), np.vdot(g, adjoint), rtol=1e-11)
    # linear, so that this is the derivative everywhere
    more = np.asarray(volume(2 * g + 1.0))
    ones = np.asarray(volume(np.ones_like(g)))
    assert np.allclose(more, 2 * np.asarray(found) + ones, atol=1e-10)


def test_derivatives_with_respect_to_projections_angles_and_axis(check_both_modes):
    grid, scan = ImageGrid((12, 4), (1.0, 0.4)), scan_of(12, whole=True)

    def volume(projections, angles, axis):
        moved = eqx.tree_at(lambda s: (s.angles, s.axis), scan, (angles, axis))
        return invert_projections(projections, moved, grid, DISK)

    projections = jnp.asarray(projections_of(BELLS, scan, grid))
    arguments = projections, scan.angles, jnp.array(0.033)
    check_both_modes(volume, arguments)


def test_from_and_into_files(shown, tmp_path, capfd):
    plan, scan, whole = shown.plan, shown.scan, np.asarray(shown.volume)
    with h5py.File(tmp_path / "scan.h5", "w") as file:
        frames = file.create_dataset("g", data=np.asarray(shown.g))
        out = file.create_dataset("volume", whole.shape, dtype="f8")
        kept = file.create_dataset("projections", (64, 33, 33), dtype="f8")
        found = reconstruct_stack(
            plan, frames, scan, out=out, projections=kept, batch_size=24, progress=True
        )
        assert found is out
        assert np.allclose(out[:], whole, atol=1e-6)
        again = invert_projections(kept[:], scan, plan.grid, plan.region)
        assert np.allclose(again, whole, atol=1e-12)
    bars = capfd.readouterr().err
    assert "64/64" in bars
    assert "33/33" in bars


def test_wrong_arguments_are_refused(shown):
    plan, scan, g = shown.plan, shown.scan, np.asarray(shown.g)
    with pytest.raises(ValueError, match=r"g has shape \(63, 130, 33\), .* 64 rotations"):
        reconstruct(plan, g[1:], scan)
    with pytest.raises(ValueError, match=r"g has shape \(64, 129, 33\)"):
        reconstruct(plan, g[:, 1:], scan)
    with pytest.raises(ValueError, match="1 NaN"):
        reconstruct(plan, np.where(g == g.max(), np.nan, g), scan)
    with pytest.raises(ValueError, match=r"axis of rotation is u = 20, but the grid runs from"):
        reconstruct_stack(plan, g, scan_of(64, axis=20.0))
    with pytest.raises(ValueError, match=r"out has shape \(33, 33\), expected \(33, 33, 33\)"):
        reconstruct_stack(plan, g, scan, out=np.empty((33, 33)))
    with pytest.raises(ValueError, match="frames has shape"):
        reconstruct_stack(plan, g[0], scan)
    with pytest.raises(ValueError, match="inversion is 'radon'"):
        reconstruct_stack(plan, g, scan, inversion="radon")
