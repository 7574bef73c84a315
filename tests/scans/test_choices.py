"""Choices keep what they are told, to the last bit, and refuse what they cannot be."""

import argparse
import dataclasses
import json
import shlex

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat.base.units import Units
from jaxtat.cli.hints import suggestions
from jaxtat.io import Scan
from jaxtat.scans import Choices, as_json, to_look_at
from jaxtat.scans.noise import with_alpha
from jaxtat.scans.parameters import Parameters

CHOICES = Choices(
    order=tuple(range(40)),
    left_out=(3, 17),
    model="in-plane",
    sound_speed=1481.1 / 3,
    time_shift=1e-7 / 3,
    dead_time=1e-6 / 3,
    band=(1e5 / 3, 7e6),
    impulse_response=True,
    region_center=(0.1, -1 / 3),
    region_radius=0.7,
    region_cut=0.5,
    region_angle=-90.0,
    pixels=21,
    half_width=0.7,
    first_radius=0.3,
    radial_step=0.07,
    n_radii=30,
    max_frequency=12.0,
    alpha=1e-3 / 3,
    low_pass="cosine",
    inversion="fbp",
    reasons=(("model", "given"), ("channels", "left out: dead 3, 17"), ("alpha", "noise")),
    grades=(("model", "sure"), ("channels", "likely"), ("alpha", "guessed")),
    standard_errors=(("alpha", 1e-4 / 3),),
)


def test_settings_give_the_choices_back_through_a_file():
    found = Choices.from_settings(json.loads(json.dumps(CHOICES.settings())))
    assert eqx.tree_equal(found, CHOICES) is True
    without = eqx.tree_at(lambda tree: tree.band, CHOICES, None, is_leaf=lambda x: x is None)
    found = Choices.from_settings(json.loads(json.dumps(without.settings())))
    assert found.band is None


def test_choices_are_a_frozen_tree_of_numbers():
    assert all(isinstance(leaf, float) for leaf in jax.tree.leaves(CHOICES))
    with pytest.raises(AttributeError):
        CHOICES.alpha = 1.0


def test_where_the_image_is():
    assert CHOICES.channels == tuple(k for k in range(40) if k not in (3, 17))
    assert CHOICES.region.automatic  # the setup has as many boundary points as are needed
    inside = CHOICES.region.contains(jnp.array([[0.1, -0.9], [0.1, -0.8], [0.1, 0.3]]))
    assert inside.tolist() == [False, True, True]  # the cut lies 0.5 below the centre
    assert np.allclose(CHOICES.grid.points[10, 10], (0.1, -1 / 3))
    assert np.allclose(CHOICES.radii, 0.3 + 0.07 * np.arange(30))
    theta = np.linspace(0.0, 4.7, 40)
    points = 1.3 * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    curve = CHOICES.curve(points)
    assert np.array_equal(curve.points, points[list(CHOICES.channels)])
    assert np.isclose(curve.weights.sum(), 1.3 * 4.7 * 40 / 39)  # neighbours stand for the two


def test_the_table_has_a_line_and_a_reason_for_each():
    lines = CHOICES.table().splitlines()
    assert [line.split()[0] for line in lines] == ["channels", "model", "alpha"]
    assert "38 of 40" in lines[0]
    assert lines[0].endswith("  likely   left out: dead 3, 17")
    assert [line.split()[-2] for line in lines[1:]] == ["sure", "guessed"]


def test_the_table_is_in_millimetres_where_units_are_known_and_free_of_rounding():
    """In metres and seconds; a centre and a cut that rounding left are zero, an angle has no -0."""
    reasons = tuple((name, "why") for name in SHOWN)
    found = dataclasses.replace(
        CHOICES,
        sound_speed=1481.1,
        dead_time=2.4871e-6,
        band=(9.857e4, 1.2612e7),
        region_center=(7e-18, -0.0121),
        region_radius=0.0129,
        region_cut=-7.9e-19,
        region_angle=-0.0,
        half_width=0.013,
        max_frequency=26409.0,
        alpha=0.1,
        reasons=reasons,
        units=Units("m", "s"),
    )
    assert {name: value for name, value, *_ in found.rows()} == SHOWN
    again = Choices.from_settings(json.loads(json.dumps(found.settings())))
    assert again.rows() == found.rows()
    bare = dataclasses.replace(found, units=Units())
    values = {name: value for name, value, *_ in bare.rows()}
    assert values["region_radius"] == "0.0129" and values["sound_speed"] == "1481.1"


SHOWN = {
    "sound_speed": "1481.1 m/s",
    "dead_time": "2.487 us",
    "band": "0.09857 to 12.61 MHz",
    "region_radius": "12.9 mm",
    "region_cut": "0 mm",
    "region_angle": "0 degrees",
    "region_center": "(0, -12.1) mm",
    "max_frequency": "26.409 rad/mm",
    "half_width": "13 mm",
    "alpha": "0.1",
}


def test_choices_for_programs_are_in_si_units():
    """Of positions in millimetres and times in microseconds, with everything that is said."""
    found = dataclasses.replace(
        CHOICES,
        sound_speed=1.5,
        region_radius=12.0,
        region_cut=12.0,
        region_center=(0.5, -12.0),
        band=(0.1, 7.0),
        max_frequency=26.0,
        units=Units("mm", "us"),
        reasons=tuple((name, "why") for name in (*SHOWN, "channels")),
        grades=(("sound_speed", "likely"),),
        standard_errors=(("sound_speed", 0.003),),
    )
    written = json.loads(json.dumps(as_json(found)))["choices"]
    said = {"value": 1500.0, "unit": "m/s", "reason": "why", "grade": "likely"}
    assert written["sound_speed"] == said | {"standard_error": 3.0}
    assert {name: (entry["value"], entry["unit"]) for name, entry in written.items()} == {
        "channels": (38, None),
        "sound_speed": (1500.0, "m/s"),
        "dead_time": (pytest.approx(1e-12 / 3), "s"),
        "band": ([1e5, 7e6], "Hz"),
        "region_radius": (0.012, "m"),
        "region_cut": (None, "m"),  # all of the disk
        "region_angle": (-90.0, "degree"),
        "region_center": ([0.0005, -0.012], "m"),
        "max_frequency": (26000.0, "rad/m"),
        "half_width": (pytest.approx(0.0007), "m"),
        "alpha": (pytest.approx(1e-3 / 3), None),
    }
    assert written["channels"]["left_out"] == [3, 17]
    assert written["alpha"]["grade"] == "guessed"  # of what nothing is said
    bare = as_json(dataclasses.replace(found, units=Units()))["choices"]
    assert (bare["sound_speed"]["value"], bare["sound_speed"]["unit"]) == (1.5, None)


def test_a_start_that_is_guessed_is_tried_up_to_a_microsecond_away():
    named = {"reasons": (("time_shift", "why"),), "grades": (("time_shift", "guessed"),)}
    found = dataclasses.replace(CHOICES, time_shift=0.0, units=Units("mm", "us"), **named)
    scan = Scan("pressure", np.zeros((40, 9)), {})
    said = suggestions(argparse.Namespace(file="a.npz"), scan, found).splitlines()
    assert said[1] == "time_shift  guessed  why"
    assert "time_shift=-1,-0.5,0,0.5,1" in shlex.split(said[2])


def test_what_is_least_sure_is_looked_at_first_and_then_what_decides_most():
    reasons = tuple((name, "why") for name in (*SHOWN, "model", "channels"))
    grades = dict.fromkeys(dict(reasons), "sure") | {"alpha": "likely", "band": "guessed"}
    found = dataclasses.replace(CHOICES, reasons=reasons, grades=tuple(grades.items()))
    assert to_look_at(found) == ["band", "alpha", "sound_speed"]
    given = found.with_reason("sound_speed", "by hand", "sure")
    given = dataclasses.replace(given, user_set=("sound_speed", "use"))
    assert to_look_at(given) == ["band", "alpha", "model"]
    assert to_look_at(given, 9).count("channels") == 0  # decided by the option use
    late = dataclasses.replace(given, reasons=(*reasons, ("time_shift", "why")))
    assert to_look_at(late, 2) == ["time_shift", "band"]  # of which nothing is said
    assert dict(given.standard_errors) == dict(found.standard_errors)
    assert given.grade("sound_speed") == "sure" and given.grade("pixels") == "guessed"


@pytest.mark.parametrize(
    ("ratio", "alpha", "why"),
    [
        (0.48, 0.1, "capped: noise over signal power 0.48, by hand"),
        (9.1e-3, 9.1e-3, "noise over signal power 0.0091, by hand"),
        (2.5e-11, 1e-6, "raised to the least: noise over signal power 2.5e-11, by hand"),
    ],
)
def test_alpha_says_what_it_means(ratio, alpha, why):
    found = with_alpha(Parameters({}, Units()), ratio, "by hand").estimates["alpha"]
    assert (found.value, found.sentence(Units())) == (alpha, why)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"model": "3d"}, "model is '3d'"),
        ({"low_pass": "hann"}, "low_pass is 'hann'"),
        ({"inversion": "radon"}, "inversion"),
        ({"band": [1.0]}, "cannot be read"),
        ({"grades": [["alpha", "certain"]]}, "grades are \\['certain'\\]"),
        ({"colour": "red"}, "unknown \\['colour'\\]"),
    ],
)
def test_wrong_settings_are_refused(change, reason):
    with pytest.raises(ValueError, match=reason):
        Choices.from_settings(CHOICES.settings() | change)
    short = {k: v for k, v in CHOICES.settings().items() if k != "alpha"}
    with pytest.raises(ValueError, match="missing \\['alpha'\\]"):
        Choices.from_settings(short)
