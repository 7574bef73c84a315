"""Live images of circular integrals against `solve`, which takes another way to the densities."""

import threading
from contextlib import contextmanager

import equinox as eqx
import jax
import numpy as np
import pytest

import jaxtat
from jaxtat import RelativeTikhonov, Tikhonov, phantoms, solve
from jaxtat.streams import images, live
from jaxtat.streams.moving_region import setup_showing

BELL = phantoms.Bells([[-0.3, 0.2], [-0.2, -0.3]], [0.4, 0.3], [1.0, -0.6])
ALPHA = 1e-4
RULES = {"half_arc": RelativeTikhonov(1e-2)}  # other than ALPHA


def data_of(setup):
    return np.asarray(BELL.circular_integrals(setup.curve, setup.radii))


def frames_of(setup):
    g = data_of(setup)
    return np.stack([g, -2 * g, 0 * g])


def relative(one, other):
    return float(np.abs(np.asarray(one) - np.asarray(other)).max() / np.abs(other).max())


def expected(setup, g, rule=ALPHA, **options):
    return np.asarray(solve(setup, g, rule, inversion="fourier", **options).image)


@eqx.filter_jit
def of_one_frequency(densities, weights):
    return densities.of_frequency(4, weights)


@pytest.mark.parametrize("name", ["arc", "half_arc", "l_shape"])
def test_it_is_the_image_of_solve(name, request):
    """On arcs mirrored, in cut disks, and where no cylindrical waves reach."""
    setup, rule = request.getfixturevalue(name), RULES.get(name, ALPHA)
    frames = frames_of(setup)
    wanted = expected(setup, frames, rule)
    found = live(setup, rule=rule, dtype=np.float64)(frames)
    assert found.shape == (3, *setup.grid.shape) and found.dtype == np.float64
    assert relative(found, wanted) < (1e-5 if name == "l_shape" else 1e-10)
    single = live(setup, rule=rule)(frames[0])
    assert single.dtype == np.float32
    assert relative(single, wanted[0]) < 1e-4


def test_other_rules_and_filters(arc):
    g = frames_of(arc)
    first = live(arc, rule=Tikhonov(1e-2), dtype=np.float64)
    other = first.replace(rule=1e-6, low_pass="cosine")
    assert relative(other(g), expected(arc, g, 1e-6, low_pass="cosine")) < 1e-10
    again = other.replace(rule=1e-2, low_pass="none")
    assert relative(again(g), first(g)) < 1e-12
    assert relative(first(g), other(g)) > 1e-3
    by_default = live(arc, dtype=np.float64)
    assert relative(by_default(g), expected(arc, g, None)) < 1e-10


def test_the_density_of_one_frequency_is_that_of_a_plan(arc):
    rule = Tikhonov(1e-3)
    one = live(arc, rule=rule, dtype=np.float64)._ready.densities
    other = jaxtat.build_plan(arc, rule).densities
    weights = arc.curve.weights
    assert relative(of_one_frequency(one, weights), of_one_frequency(other, weights)) < 1e-8


@pytest.fixture(scope="module")
def small(arc):
    """A smaller disk in the circle that the data cover."""
    radii = jaxtat.data_radii(arc.curve, jaxtat.disk(0.9), 0.05)
    return jaxtat.Setup(arc.curve, jaxtat.disk(0.6), jaxtat.ImageGrid(21, 0.6), radii)


def moved_setup(setup, center):
    """Made anew: with as many orders as are needed there."""
    region, grid = jaxtat.disk(0.6, center=center), jaxtat.ImageGrid(21, 0.6, center=center)
    highest = setup.sizes.max_frequency
    return jaxtat.Setup(setup.curve, region, grid, setup.radii, max_frequency=highest)


ANGLES = np.linspace(0.4, 5.5, 60)
CURVES = {  # arcs on a circle, which all sides of the disk see; straight pieces of an ellipse
    "circle": jaxtat.circular_arc(1.3, 0.1, 60, element_width=0.15),
    "ellipse": jaxtat.detector_curve(
        np.stack([1.4 * np.cos(ANGLES), 1.25 * np.sin(ANGLES)], axis=1), element_width=0.15
    ),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jaxtat.VisibilityWarning")
@pytest.mark.parametrize(
    ("name", "center"),
    [
        ("circle", [0.3, -0.35]),  # where low frequencies need more orders
        ("ellipse", [0.1, -0.05]),
    ],
)
def test_another_center(name, center):
    """That leaves the disk which is solved for: the systems of the moved one, as `solve` has them.

    Alpha counts in the unit of `solve`, which is another for detectors on a circle and off it.
    """
    curve, center = CURVES[name], np.array(center)
    radii = jaxtat.data_radii(curve, jaxtat.disk(1.1), 0.06)
    setup = jaxtat.Setup(curve, jaxtat.disk(0.6), jaxtat.ImageGrid(21, 0.6), radii)
    g, there = data_of(setup), moved_setup(setup, center)
    first = live(setup, rule=ALPHA, dtype=np.float64)
    moved = first.replace(region_center=center)
    assert relative(moved(g), expected(there, g)) < 1e-10
    other = moved.replace(rule=1e-2, low_pass="cosine")
    assert relative(other(g), expected(there, g, 1e-2, low_pass="cosine")) < 1e-10
    back = other.replace(region_center=[0.0, 0.0], rule=1e-6)
    assert relative(back(g), first.replace(rule=1e-6, low_pass="cosine")(g)) < 1e-10


def test_a_cut_disk_moves(half_arc):
    first = live(half_arc, rule=1e-2, dtype=np.float64)
    moved = first.replace(region_center=[-0.05, 0.02])
    region = jaxtat.disk(1.0, 0.0, center=[-0.05, 0.02])
    there = jaxtat.Setup(
        half_arc.curve,
        region,
        jaxtat.ImageGrid(half_arc.grid.shape, center=[-0.05, 0.02]),
        half_arc.radii,
        max_frequency=half_arc.sizes.max_frequency,
    )
    g = data_of(half_arc)
    assert relative(moved(g), expected(there, g, 1e-2)) < 1e-10


def test_images_go_on_until_another_center_is_ready(small, monkeypatch):
    g, center, go = data_of(small), [0.1, -0.05], threading.Event()
    first = live(small, rule=ALPHA)
    before, showing = first(g), images.setup_showing

    def later(*arguments):
        assert go.wait(60)
        return showing(*arguments)

    monkeypatch.setattr(images, "setup_showing", later)
    future = first.replace_in_background(region_center=center)
    assert np.array_equal(first(2 * g), 2 * before) and not future.done()
    go.set()
    assert np.array_equal(future.result(60)(g), first.replace(region_center=center)(g))
    with pytest.raises(ValueError, match="expected a value above zero"):
        first.replace_in_background(rule=-1.0).result(60)


@pytest.mark.filterwarnings("ignore::jaxtat.VisibilityWarning")
def test_radii_for_another_center_hold_the_slower_sound_of_a_body():
    """Up to the end of the record, which is later than that of sound in water alone."""
    medium = jaxtat.DiskBody((0.0, 0.0), 0.45, 0.85, 1.0)
    where = jaxtat.circular_arc(1.0, 1.0, 60), jaxtat.disk(0.3), jaxtat.ImageGrid(17, 0.3)
    setup = jaxtat.Setup(*where, medium=medium)
    moved = jaxtat.disk(0.3, center=(0.1, 0.0)).with_counts(setup.region.counts)
    there, solved_anew = setup_showing(setup, setup.region, moved, 3.0)
    farthest = 1.1 + 0.3 + (1 / 0.85 - 1) * (0.45 + 0.4)  # through the body from its near side
    assert solved_anew and farthest - 1e-3 < there.radii[-1] < farthest + 0.1
    with pytest.raises(ValueError, match="record longer"):
        setup_showing(setup, setup.region, moved, farthest - 0.1)


@pytest.mark.filterwarnings("ignore::jaxtat.VisibilityWarning")
@pytest.mark.parametrize(("center", "said"), [([0.5, 0.0], "radii run from"), ([9.0, 9.0], "unit")])
def test_a_center_without_data_is_refused(small, center, said):
    with pytest.raises(ValueError, match=rf"a disk of radius 0.6 about \({center[0]:g}, .*{said}"):
        live(small, rule=ALPHA).replace(region_center=center)


def test_another_center_within_reach_is_the_same_function_at_other_pixels(small):
    g, center, radius = data_of(small), np.array([0.1, -0.2]), 0.5
    first = live(small, rule=ALPHA, dtype=np.float64, reach=0.85)
    moved = first.replace(region_center=center, region_radius=radius)
    assert moved._waves is first._waves  # nothing is solved again
    grid = jaxtat.ImageGrid(21, radius, center=center)
    highest = small.sizes.max_frequency
    wide = jaxtat.Setup(small.curve, jaxtat.disk(0.85), grid, small.radii, max_frequency=highest)
    assert relative(moved(g), live(wide, rule=ALPHA, dtype=np.float64)(g)) < 1e-10
    # what lies in both disks comes out alike, whichever the systems are for
    inside = np.asarray(moved.region.contains(grid.points))
    truth = np.asarray(BELL.image(grid))
    assert np.abs(moved(g) - truth)[inside].max() < 0.05 * np.abs(truth).max()
    assert relative(moved.replace(region_center=[0, 0], region_radius=0.6)(g), first(g)) < 1e-12
    with pytest.raises(ValueError, match=r"region_radius is 0\.9, and densities are for a disk"):
        first.replace(region_radius=0.9)


def test_the_densities_of_a_plan(arc, arc_plan):
    g = data_of(arc)
    planned = live(arc, plan=arc_plan, dtype=np.float64)
    wanted = jaxtat.reconstruct(arc_plan, g, inversion="fourier")
    assert relative(planned(g), wanted) < 1e-10
    assert relative(live(arc, plan=arc_plan)(g), wanted) < 1e-4
    for changed in ({"rule": 1e-3}, {"region_center": [0.001, 0.0]}):
        with pytest.raises(ValueError, match="densities of a plan"):
            planned.replace(**changed)


@contextmanager
def compiled():
    """How many programs are compiled meanwhile."""
    events = []

    def listen(event, *_, **__):
        if "backend_compile" in event:
            events.append(event)

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        yield events
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)


def test_nothing_is_compiled_for_another_number(arc):
    """Alpha, low-pass, region and frames of another value."""
    g = data_of(arc)
    first = live(arc, rule=ALPHA)
    first.replace(rule=1e-2, low_pass="cosine", region_center=[0.0, 0.0], region_radius=0.9)(g)
    with compiled() as programs:
        first.replace(rule=3e-3, low_pass="none")(2 * g)
        first.replace(region_center=[0.1, -0.2], region_radius=0.6)(g, energy=3.0)
    assert not programs


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        (np.zeros((80, 20)), r"shape \(80, 20\) and type float64, expected real numbers"),
        (np.zeros(21), r"expected real numbers \(\.\.\., 80, 21\)"),
        (np.zeros((80, 21), complex), "type complex128"),
        (np.array(["a"]), "frames"),
        (np.full((80, 21), np.nan), "1680 NaN or infinite values"),
        (np.zeros((2, 0, 80, 21)), r"shape \(2, 0, 80, 21\): a stack of no frames at all"),
    ],
)
def test_frames_that_cannot_be_are_refused(arc, frames, said):
    to_images = live(arc, rule=ALPHA)
    with pytest.raises(ValueError, match=said):
        to_images(frames)


@pytest.mark.parametrize("size", [1e38, 1e-40])
def test_sizes_that_single_precision_does_not_hold_are_refused(arc, size):
    """In double precision they are as good as others; an image is of any other size, or refused."""
    g = data_of(arc)
    single, double = live(arc, rule=ALPHA), live(arc, rule=ALPHA, dtype=np.float64)
    frame = size * g / np.abs(g).max()
    with pytest.raises(ValueError, match=r"frames of 1e.[0-9]+: images are in float32"):
        single(np.stack([g, frame]))
    assert relative(double(frame) / size, double(g) / np.abs(g).max()) < 1e-12
    with pytest.raises(ValueError, match="energy of"):
        single(g, energy=size)
    with pytest.raises(ValueError, match="images are in float64"):
        double(frame * (1e250 if size > 1 else 1e-210))
    assert not np.asarray(single(0 * g)).any()


@pytest.mark.parametrize("rule", [1e-300, 1e-18, RelativeTikhonov(1e-12)])
def test_alpha_below_rounding_is_refused(arc, rule):
    with pytest.raises(ValueError, match="less than rounding, 1e-15: take a larger alpha"):
        live(arc, rule=rule)
    with pytest.raises(ValueError, match="less than rounding, 1e-15: take a larger alpha"):
        live(arc, rule=ALPHA).replace(rule=rule)


def test_settings_that_cannot_be_are_refused(arc, half_arc, arc_plan, cap):
    with pytest.raises(ValueError, match="expected float32 or float64"):
        live(arc, dtype=np.float16)
    with pytest.raises(ValueError, match="the setup is in space"):
        live(cap)
    with pytest.raises(ValueError, match="leave it out with a plan"):
        live(arc, plan=arc_plan, reach=1.1)
    with pytest.raises(ValueError, match="only a plan forms"):
        live(arc, rule=jaxtat.NormBound(4.0))
    with pytest.raises(ValueError, match="depends on the data"):
        live(arc, rule=jaxtat.NoiseLevel(0.1))
    with pytest.raises(ValueError, match="circular integrals are made at one"):
        live(arc, rule=ALPHA).replace(sound_speed=1.1)
    with pytest.raises(ValueError, match="circular integrals have no times"):
        live(arc, rule=ALPHA).replace(time_shift=0.1)
    with pytest.raises(ValueError, match="expected at least the region's radius 1"):
        live(arc, reach=0.9)
    with pytest.raises(ValueError, match="reach is for whole disks"):
        live(half_arc, reach=1.0)
    with pytest.raises(ValueError, match="region_radius is for whole disks"):
        live(half_arc, rule=ALPHA).replace(region_radius=0.5)
    with pytest.raises(ValueError, match="expected 'none'"):
        live(arc, rule=ALPHA).replace(low_pass="hann")
