"""The parts of benchmarks/learned: shapes, descent, training, what counts as invented; the page."""

import json
import re
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxtat import ImageGrid, VisibilityWarning

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ROOT / "benchmarks" / "learned"


@pytest.fixture(scope="module", autouse=True)
def scripts():
    sys.path.insert(0, str(SCRIPTS))
    yield
    sys.path.remove(str(SCRIPTS))


def test_a_stroke_has_its_area_and_halving_keeps_it():
    from shapes import Strokes, drawn, halved

    a, b = np.array([[-0.3, 0.1]]), np.array([[0.4, 0.2]])
    one = np.ones(1)
    image = drawn(Strokes(a, b, 0.1 * one, 0.1 * one, 2 * one), ImageGrid(129))
    area = 2 * (np.pi * 0.01 + 0.2 * np.hypot(0.7, 0.1))  # a capsule, twice as bright as 1
    assert image.sum() / 64**2 == pytest.approx(area, rel=1e-2)
    assert halved(image).sum() / 32**2 == pytest.approx(image.sum() / 64**2, rel=1e-6)


@pytest.mark.parametrize("name", ["vessels", "disks", "rings"])
def test_shapes_stay_where_they_may_be(name):
    import shapes

    for seed in range(20):
        strokes = getattr(shapes, name)(np.random.default_rng(seed))
        for ends, radii in ((strokes.a, strokes.radius_a), (strokes.b, strokes.radius_b)):
            assert (np.linalg.norm(ends, axis=1) <= shapes.REACH + 1e-12).all()
            assert (radii > 0).all()


@pytest.fixture(scope="module")
def small(scripts):
    from problem import problem

    with pytest.warns(VisibilityWarning):
        return problem(17, 12)


def test_untrained_it_is_gradient_descent_and_training_lowers_the_loss(small):
    """In a system of three unknowns, whose steps are written out here."""
    from network import Unrolled, n_parameters, trained

    rng = np.random.default_rng(0)
    matrix = (rng.standard_normal((6, 9)) / 3).astype(np.float32)
    truth = rng.random((4, 3, 3)).astype(np.float32)
    g = np.asarray(truth.reshape(4, 9) @ matrix.T)
    weight = np.linspace(0.5, 1.0, 6).astype(np.float32)

    def forward(x):
        return x.reshape(-1, 9) @ matrix.T

    def back(y):
        return (y @ matrix).reshape(-1, 3, 3)

    network = Unrolled.drawn(rng, steps=2, channels=3)
    assert n_parameters(network) == 2 * (9 * (2 * 3 + 3 * 3 + 3) + 3 + 3 + 1)
    x = start = 0 * truth
    for _ in range(2):
        x = x + 0.2 * back(weight * (g - forward(x)))
    found = jax.jit(lambda start, g: network(start, g, forward, back, weight))(start, g)
    np.testing.assert_allclose(found, x, atol=1e-5)

    def loss(network, start, g, truth):
        return jnp.mean((network(start, g, forward, back, weight) - truth) ** 2)

    _, history = trained(network, loss, (start, g, truth), batch=4, steps=60, rate=0.02, seed=0)
    assert history[-1] < 0.5 * history[0]


def test_residuals_are_in_units_of_the_noise_and_the_truth_invents_nothing(small):
    from judged import judged, residuals
    from problem import examples
    from shapes import disks

    some = examples(small, disks, 3, seed=0)
    power = (some.g**2).mean(axis=(1, 2))
    np.testing.assert_allclose(residuals(small, 0 * some.truth, some) * some.sigma, power**0.5)
    # noise of 5 %, and the coarse pixels' error of the same size
    assert 0.9 < residuals(small, some.truth, some).mean() < 3.0
    seen = np.where(np.arange(17)[:, None] < 8, 0.95, 0.5) * np.ones((17, 17))
    for found in judged(some.truth, some, seen, small.inside).values():
        assert found == {"error": 0.0, "invented": 0.0, "missed": 0.0}
    empty = ~(some.truth > 0).any(axis=0) & small.inside
    far = np.argwhere(empty & (np.hypot(*np.moveaxis(small.setup.grid.points, -1, 0)) > 0.93))
    more, less = some.truth.copy(), np.where(some.truth > 0.5, 0.0, some.truth)
    more[:, far[0][0], far[0][1]] = 1.0
    assert sum(part["invented"] for part in judged(more, some, seen, small.inside).values()) > 0
    assert judged(less, some, seen, small.inside)["nearly all"]["missed"] == 1.0


def test_the_page_says_what_was_measured():
    results = json.loads((SCRIPTS / "results.json").read_text())
    page = (ROOT / "docs" / "learned.md").read_text()
    table = re.findall(r"^\| (vessels|disks|rings)\b[^|]*\| ([\w-]+) \| (.*) \|$", page, re.M)
    assert len(table) == 9
    for name, way, numbers in table:
        measured = results["tried"][name][way]
        parts = measured["by_visibility"]
        wanted = [measured["error"], parts["nearly all"]["error"], parts["fewer"]["error"]]
        wanted += [parts["fewer"]["invented"], measured["residual"]]
        told = [float(number) for number in numbers.split(" | ")]
        np.testing.assert_allclose(told, wanted, atol=0.0051, rtol=0)
    of_truth = "{vessels:.2f}, {disks:.2f} and {rings:.2f}".format(**results["residual_of_truth"])
    assert of_truth in page
    assert f"{results['parameters']} parameters" in page
    assert f"{results['training']['steps']} steps" in page
