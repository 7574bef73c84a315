"""A few geometries of benchmarks/robustness/random_geometries.py, and what is told of them."""

import sys
from pathlib import Path

import pytest

from jaxtat import AccuracyWarning, VisibilityWarning

SCRIPTS = Path(__file__).parents[1] / "benchmarks" / "robustness"


@pytest.fixture(scope="module")
def script():
    sys.path.insert(0, str(SCRIPTS))
    try:
        import random_geometries
    finally:
        sys.path.remove(str(SCRIPTS))
    return random_geometries


def test_a_failure_without_a_warning_is_called_so(script):
    def verdict(error, beyond, *warned):
        return script.Outcome(error, beyond, frozenset(warned)).verdict

    assert verdict(0.2, 0.2) == "SILENT FAILURE"
    assert verdict(0.2, 0.2, VisibilityWarning) == "failed, warned"
    assert verdict(0.2, 0.01) == verdict(0.01, 0.2) == "good"  # resolution, or luck
    assert verdict(0.01, 0.01, AccuracyWarning) == "false alarm"
    assert verdict(0.01, 0.01, VisibilityWarning) == "good, warned"


def test_detectors_in_no_order_are_refused(script):
    with pytest.raises(ValueError, match="not in order"):
        script.draw(7)


def test_what_is_seen_nowhere_has_no_verdict(script):
    """Two arcs that record some edges of every pixel, and all of none."""
    with pytest.raises(ValueError, match="nowhere in the region"):
        script.judge(script.draw(2011))


def test_what_fails_is_announced(script):
    """An image by 8 scattered detectors, compared where all of it is seen."""
    outcome = script.judge(script.draw(1004))
    assert outcome.failed, outcome
    assert AccuracyWarning in outcome.warned, outcome
