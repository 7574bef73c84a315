"""The acoustic model, told by images where the record does not tell it."""

import warnings

import numpy as np
import pytest
from made_scans import BELLS, RATE, SPEED, TIMES, positions, record

from jaxtat import detector_curve, phantoms
from jaxtat.geometry import VisibilityWarning
from jaxtat.io import Scan
from jaxtat.records import circular_integrals_to_pressure
from jaxtat.scans import choose, estimate
from jaxtat.scans.model import OTHER, better_model, in_doubt
from jaxtat.steps import AccuracyWarning

ARC, HALF, SHORT = slice(None), slice(15, 75), slice(25, 65)  # 270, 179 and 118 degrees


def waves():
    """Two-dimensional waves of the bells, from exact integrals."""
    radii = np.arange(1e-3, 62e-3, 4e-4)
    bells = phantoms.Bells(BELLS["centers"], BELLS["radii"], [1.0, 0.7, 0.5])
    g = bells.circular_integrals(detector_curve(positions()[:, :2]), radii)
    return np.asarray(circular_integrals_to_pressure(g, radii, SPEED * TIMES))


def saved(pressure, rows, drift=0.0, samples=None):
    """A file of numbers in the plane, with 2 % of noise, that does not tell its model."""
    largest, rng = np.abs(pressure).max(), np.random.default_rng(0)
    dirt = 0.02 * rng.standard_normal(pressure.shape) + drift * TIMES / TIMES[-1]
    known = {"detectors": positions()[rows, :2], "sampling_rate": RATE}
    return Scan("pressure", (pressure + largest * dirt)[rows, :samples], known)


def told(made):
    """Model, grade and reason."""
    first = choose(made)
    found = better_model(made, first, choose(made, model=OTHER[first.model]))
    return found.model, found.grade("model"), dict(found.reasons)["model"]


@pytest.mark.parametrize(("rows", "model"), [(HALF, "2d"), (HALF, "in-plane"), (ARC, "in-plane")])
def test_what_is_seen_from_two_sides_tells_the_model(rows, model):
    """A record of elements focused into the plane drifts, which looks like a tail of waves."""
    made = saved(waves() if model == "2d" else record(), rows, 0.05 * (model == "in-plane"))
    chosen = choose(made)
    assert (chosen.model, chosen.grade("model")) == ("2d", "guessed")
    found, grade, why = told(made)
    assert (found, grade) == (model, "likely")
    assert why.startswith("an image explains the record better as ")


def test_a_model_by_which_no_speed_is_found_is_a_guess(monkeypatch):
    """Its dip is the deeper one, but the wrong model's may be, where body and water differ."""
    monkeypatch.setattr("jaxtat.scans.best_explained.ELSEWHERE", 0.0)
    found, grade, _ = told(saved(record(), HALF, 0.05))
    assert (found, grade) == ("in-plane", "guessed")


def test_a_record_that_ends_early_gives_a_guess():
    """What arrives late is missing, by which the wrong model has been told."""
    made = saved(waves(), HALF, samples=round(0.046 / 1500 * RATE))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        _, grade, why = told(made)
    assert grade == "guessed" and why.endswith(", but the record ends early")


@pytest.mark.parametrize("model", ["2d", "in-plane"])
def test_where_edges_are_seen_once_the_sign_gives_a_guess(model):
    made = saved(waves() if model == "2d" else record(), SHORT, 0.05 * (model == "in-plane"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        found, grade, why = told(made)
    assert (found, grade) == (model, "guessed") and "the image is less negative" in why


def test_all_other_choices_are_those_of_the_model_that_is_told():
    made = saved(record(), HALF, 0.05)
    with warnings.catch_warnings():
        warnings.simplefilter("error", AccuracyWarning)  # of the model there is nothing to warn
        warnings.simplefilter("ignore", VisibilityWarning)
        found = estimate(made, choose(made, pixels=41), pixels=41)
    asked = choose(made, model="in-plane", pixels=41)
    for name in ("band", "alpha", "low_pass", "region_radius", "pixels"):
        assert getattr(found, name) == getattr(asked, name), name


def test_options_of_choose_are_not_lost():
    made = saved(record(), HALF, 0.05)
    for options in ({"pixels": 41}, {"use": np.arange(59)}, {"region_radius": 0.012}):
        with pytest.raises(ValueError, match=f"with {next(iter(options))} given: give estimate"):
            estimate(made, choose(made, **options))


def test_a_given_model_is_not_in_doubt():
    made = saved(record(), HALF, 0.05)
    assert in_doubt(choose(made)) and not in_doubt(choose(made, model="2d"))


def test_a_short_record_that_ends_early_keeps_its_guess_and_warns():
    """Edges are seen once, and there are no images to compare."""
    made = saved(waves(), SHORT, samples=round(0.05 / 1500 * RATE))
    chosen = choose(made)
    with pytest.warns(AccuracyWarning, match="slow tail; a scanner's record needs model in-plane"):
        found = better_model(made, chosen, choose(made, model="in-plane"))
    assert (found.model, found.grade("model")) == ("2d", "guessed")
