"""One choice at several values: images that differ by it alone."""

import numpy as np
import pytest
from made_scans import SPEED, raw_counts, record, scan

from jaxtat import ImageGrid, Setup, circular_arc, data_radii, disk, phantoms, reconstruct
from jaxtat.io import Scan
from jaxtat.scans import choose, trials

# as in tests/cli/test_cli.py, so that programs are shared
CURVE, MAX_FREQUENCY = circular_arc(1.3, 1.0, 24), 2 * np.pi / 0.8
RADII = np.asarray(data_radii(CURVE, disk(0.8), 0.16))
DATA = np.asarray(phantoms.Bells([[0.1, -0.15]], [0.6]).circular_integrals(CURVE, RADII))
SCAN = Scan(
    "circular_integrals",
    np.stack([DATA, 0 * DATA]),
    {"detectors": np.asarray(CURVE.points), "radii": RADII},
)
GIVEN = {"region_radius": 0.8, "pixels": 11, "max_frequency": MAX_FREQUENCY}


def test_images_are_those_of_each_value_and_differ_by_nothing_else():
    chosen = choose(SCAN, **GIVEN)
    found = list(trials(SCAN, chosen, GIVEN, "alpha", [1e-6, 1e-1]))
    setup = Setup(CURVE, disk(0.8), ImageGrid(11, 0.8), RADII, max_frequency=MAX_FREQUENCY)
    inside = np.asarray(setup.region.contains(setup.grid.points))
    for one, alpha in zip(found, (1e-6, 1e-1), strict=True):
        assert one.choices.alpha == alpha and one.choices.low_pass == chosen.low_pass
        wanted = np.asarray(reconstruct(setup, DATA, alpha))
        image = one.image.reshape(11, 11)
        np.testing.assert_allclose(image[inside], wanted[inside], atol=1e-8)
    assert np.abs(found[0].image - found[1].image).max() > 0.01


@pytest.fixture
def tried(monkeypatch):
    """A record, and a function (name, values) -> choices of the trials."""
    made = scan(raw_counts(record()), sound_speed=SPEED)
    monkeypatch.setattr("jaxtat.scans.parameter_sweep.reconstruct", lambda scan, choices: choices)
    return made, lambda name, values: list(trials(made, choose(made), {}, name, values))


def test_a_speed_leaves_the_region_as_it_was(tried):
    """Which the choice would let grow with it."""
    raw, found = tried
    chosen, made = choose(raw), found("sound_speed", [1450.0, 1550.0])
    assert [one.sound_speed for one in made] == [1450.0, 1550.0]
    for name in ("region_radius", "max_frequency", "pixels", "alpha", "band", "dead_time"):
        assert getattr(made[0], name) == getattr(made[1], name) == getattr(chosen, name), name
    assert choose(raw, sound_speed=1550.0).region_radius != chosen.region_radius


def test_what_follows_from_a_choice_follows_it(tried):
    """A smaller region has fewer pixels and is shown wholly."""
    raw, found = tried
    small, large = found("region_radius", [5e-3, 20e-3])
    assert (small.half_width, large.half_width) == (5e-3, 20e-3)
    assert small.pixels < large.pixels
    assert small.max_frequency == large.max_frequency == choose(raw).max_frequency


def test_a_value_that_cannot_be_ends_it_before_the_first_image(monkeypatch):
    monkeypatch.setattr(
        "jaxtat.scans.parameter_sweep.reconstruct", lambda *_: pytest.fail("too late")
    )
    with pytest.raises(ValueError, match=r"region_radius 1\.365 cannot be tried: .* lie inside"):
        trials(SCAN, choose(SCAN, **GIVEN), {}, "region_radius", [0.8, 1.365])


@pytest.mark.parametrize(
    ("name", "reason"),
    [("model", "model cannot be tried"), ("sound_speed", "is of pressure records")],
)
def test_what_cannot_be_tried_is_refused(name, reason):
    with pytest.raises(ValueError, match=reason):
        trials(SCAN, choose(SCAN, **GIVEN), GIVEN, name, [1.0])
