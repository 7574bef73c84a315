"""No result depends on the wording of a sentence."""

import ast
import dataclasses
import warnings
from pathlib import Path

import numpy as np
import pytest
from made_scans import RATE, SPEED, positions, record

import jaxtat
from jaxtat.io import Scan
from jaxtat.scans import Choices, as_json, choose, reconstruct, to_look_at
from jaxtat.scans.estimate import Estimate
from jaxtat.steps import AccuracyWarning

HALF = slice(15, 75)  # of the detectors: 179 degrees
WORDS = {"reasons", "reason", "why"}
FOLDERS = ("scans", "cli", "viewer", "reporting", "streams", "studies", "reconstruction")


def made():
    """A file of numbers in the plane that tells neither its model nor its speed of sound."""
    rng, exact = np.random.default_rng(0), record()
    noisy = exact + 0.02 * np.abs(exact).max() * rng.standard_normal(exact.shape)
    known = {"detectors": positions()[HALF, :2], "sampling_rate": RATE}
    return Scan("pressure", noisy[HALF], known)


def decided(scan, **options):
    """All that was chosen, but the words."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        choices = choose(scan, **options)
    entries = as_json(choices)["choices"]
    for entry in entries.values():
        del entry["reason"]
    fields = {f.name: getattr(choices, f.name) for f in dataclasses.fields(choices)}
    del fields["reasons"]
    return fields, entries, to_look_at(choices, 9), list(dict(choices.reasons))


def test_other_words_give_the_same_choices(monkeypatch):
    options = (
        {"two_speeds": False},
        {"sound_speed": SPEED, "model": "in-plane", "low_pass": "none"},
    )
    wanted = [decided(made(), **some) for some in options]
    sentence, with_reason = Estimate.sentence, Choices.with_reason
    monkeypatch.setattr(Estimate, "sentence", lambda self, units: sentence(self, units)[::-1])
    monkeypatch.setattr(
        Choices,
        "with_reason",
        lambda self, name, reason, *of: with_reason(self, name, reason[::-1], *of),
    )
    assert [decided(made(), **some) for some in options] == wanted
    speeds = [fields["sound_speed"] for fields, *_ in wanted]
    assert speeds[0] != 1500.0 and speeds[1] == SPEED  # one was estimated


def test_too_few_detectors_for_a_frequency_that_is_given_are_said():
    """The table says so where none is given."""
    known = {"detectors": positions()[::6], "sampling_rate": RATE, "sound_speed": SPEED}
    few = Scan("pressure", record()[::6], known)
    chosen = choose(few, region_radius=0.011, pixels=91)
    above = choose(few, region_radius=0.011, pixels=91, max_frequency=7000.0)
    assert dict(above.reasons)["max_frequency"].startswith("given; ")
    with pytest.warns(AccuracyWarning, match="detectors are too few"):
        reconstruct(few, above)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reconstruct(few, chosen)


def is_of_words(node):
    """Whether an expression is a sentence, or looks one up."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, str) and (" " in node.value.strip() or node.value == "given")
    if isinstance(node, ast.Subscript):
        return is_of_words(node.value)
    if isinstance(node, ast.Call):
        called = node.func
        lookup = isinstance(called, ast.Attribute) and called.attr == "get"
        parts = [called.value] if lookup else node.args
        return any(is_of_words(part) for part in parts)
    if isinstance(node, ast.Attribute):
        return node.attr in WORDS
    return isinstance(node, ast.Name) and node.id in WORDS


def comparisons(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            keys = isinstance(node.ops[0], ast.In | ast.NotIn)  # whether there is an entry
            yield node, [node.left, *([] if keys else node.comparators)]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if node.func.attr in ("startswith", "endswith", "find", "match", "search"):
                yield node, [node.func.value, *node.args]
            elif node.func.attr == "filterwarnings":
                yield node, node.args[1:]


@pytest.mark.parametrize("folder", FOLDERS)
def test_nothing_is_decided_by_comparing_words(folder):
    for path in (Path(jaxtat.__file__).parent / folder).glob("**/*.py"):
        for node, compared in comparisons(ast.parse(path.read_text())):
            of_words = any(map(is_of_words, compared))
            assert not of_words, f"{path.name}:{node.lineno}: {ast.unparse(node)}"
