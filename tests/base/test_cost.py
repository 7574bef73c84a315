"""Memory and time by sizes: what cannot fit is refused with what does, before any work."""

import numpy as np
import psutil
import pytest

import jaxtat
from jaxtat.base import cost
from jaxtat.base.cost import (
    Cost,
    LongWorkWarning,
    Systems,
    image_cost,
    require_room,
    systems_cost,
)
from jaxtat.fitting.fit_memory import memory_of_fit
from jaxtat.spherical import DetectorPoints, ball

GIGA = 1e9


def test_the_largest_size_that_fits_is_named(monkeypatch):
    """Of n pixels that take n² bytes, 31 fit into 1000."""
    monkeypatch.setattr(cost, "available_memory", lambda: 1000.0)
    require_room(lambda n: Cost(float(n * n), 0.0), 31)
    with pytest.raises(ValueError, match=r"32 pixels a side take at least .* at most 31 fit"):
        require_room(lambda n: Cost(float(n * n), 0.0), 32)


def test_long_work_is_said_beforehand():
    require_room(lambda n: Cost(1.0, 200.0), 32)
    with pytest.warns(LongWorkWarning, match="32 pixels a side take 20 minutes or more"):
        require_room(lambda n: Cost(1.0, 1200.0), 32)


@pytest.mark.parametrize("given", [{}, {"max_frequency": 10.0}])
def test_images_that_do_not_fit_are_refused_at_the_entry(monkeypatch, arc, given):
    monkeypatch.setattr(cost, "available_memory", lambda: 8 * GIGA)
    with pytest.raises(ValueError, match="20000 pixels a side take at least") as caught:
        jaxtat.Setup(arc.curve, arc.region, jaxtat.ImageGrid(20000), arc.radii, **given)
    fits = int(str(caught.value).split("at most ")[1].split()[0])
    assert 0.8 < fits / np.sqrt(8 * GIGA / cost.BYTES_PER_PIXEL) <= 1
    jaxtat.Setup(arc.curve, arc.region, jaxtat.ImageGrid(4), arc.radii, **given)


def test_fits_in_space_that_do_not_fit_are_refused_with_what_does(monkeypatch):
    """Before anything is made; and by what was measured of 65 voxels and 709 elements: 1.22 GB."""
    points = np.random.default_rng(0).standard_normal((709, 3))
    points *= 2 / np.linalg.norm(points, axis=1, keepdims=True)
    setup = jaxtat.Setup(
        DetectorPoints(points), ball(1.0), jaxtat.VolumeGrid(65), max_frequency=10.0
    )
    times = np.linspace(0.9, 3.1, 144)
    assert memory_of_fit(setup.curve, setup.grid, 1.0, None, 144).nbytes == pytest.approx(
        1.22 * GIGA, rel=0.15
    )
    monkeypatch.setattr(cost, "available_memory", lambda: 0.6 * GIGA)
    with pytest.raises(
        ValueError, match=r"65 voxels a side of a fit take at least 1\.\d* GB"
    ) as no:
        jaxtat.model_based(setup, np.ones((709, 144)), times=times)
    fits = int(str(no.value).split("at most ")[1].split()[0])
    assert 20 < fits < 50 and f"choose {fits} (--pixels)" in str(no.value)


@pytest.mark.parametrize(
    ("work", "room"), [("direct", 0.016), ("cylindrical", 0.02), ("collocation", 0.05)]
)
def test_systems_that_do_not_fit_are_refused_with_the_frequency_that_does(monkeypatch, work, room):
    """Few pixels, but waves beyond the memory; with what is named the same problem is accepted."""
    curve, region = jaxtat.circular_arc(1.3, 1.0, 24), jaxtat.disk(1.0, n_boundary=800)
    problem = curve, region, jaxtat.ImageGrid(17), np.linspace(0.28, 2.32, 400)

    def asked(highest):
        setup = jaxtat.Setup(*problem, max_frequency=highest)
        if work != "direct":
            jaxtat.build_plan(setup, method=work)

    monkeypatch.setattr("jaxtat.reconstruction.plan.unit_norms", stop)
    monkeypatch.setattr(cost, "available_memory", lambda: room * GIGA)
    with pytest.raises(ValueError, match="128 frequencies for 24 detectors and 400") as caught:
        asked(200.0)
    said = caught.value.args[0]
    fits = int(said.split("at most ")[1].split()[0])
    highest = float(said.split("max_frequency=")[1].rstrip("."))
    assert 0 < fits < 128
    assert highest == pytest.approx(200.0 * fits / 128, rel=1e-3)
    if work == "direct":
        asked(highest * 0.99)
    else:
        with pytest.raises(RuntimeError, match="accepted"):
            asked(highest * 0.99)


def stop(*geometry, **options):
    """In place of what follows when a plan was found to fit."""
    raise RuntimeError("accepted")


def test_more_of_anything_costs_more():
    small = Systems(100, 100, 50, 64, rows=200)
    larger = [
        small._replace(**{name: 3 * getattr(small, name)})
        for name in ("n_detectors", "n_radii", "n_frequencies", "n_directions", "rows")
    ]
    larger += [small._replace(n_boundary=400), small._replace(on_circle=False)]
    for plan in (None, "cylindrical", "sampled"):
        least = systems_cost(small, plan)
        assert systems_cost(small._replace(blocks=2), plan).nbytes <= least.nbytes
        costs = [systems_cost(sizes, plan) for sizes in larger]
        assert all(found.nbytes >= least.nbytes for found in costs)
        assert all(found.seconds >= least.seconds for found in costs)


def test_more_pixels_directions_and_frequencies_cost_more():
    small = image_cost((100, 100), 50, 64)
    for larger in (
        image_cost((200, 100), 50, 64),
        image_cost((100, 100), 5000, 64),
        image_cost((100, 100), 50, 128),
        image_cost((100, 100, 100), 50, 64),
    ):
        assert larger.nbytes > small.nbytes
        assert larger.seconds >= small.seconds


def test_free_memory_is_the_systems():
    assert 1e6 < cost.available_memory() <= psutil.virtual_memory().total


@pytest.mark.parametrize(
    ("line", "folder", "wanted"),
    [
        ("0::/a/b", "a", 60),
        ("0::/a/b", "", 60),
        ("0::/", "", 60),
        ("3:cpu:/a", "a", np.inf),
        (None, "a", np.inf),
    ],
)
def test_control_groups_count_those_around_too(tmp_path, line, folder, wanted):
    (tmp_path / "proc/self").mkdir(parents=True)
    if line is not None:
        (tmp_path / "proc/self/cgroup").write_text(line + "\n")
    group = tmp_path / "sys/fs/cgroup" / folder
    group.mkdir(parents=True)
    (group / "memory.current").write_text("40\n")
    (group / "memory.max").write_text("100\n")
    assert cost.group_memory(tmp_path) == wanted
    (group / "memory.max").write_text("max\n")
    assert cost.group_memory(tmp_path) == np.inf


@pytest.mark.skipif(not hasattr(psutil, "RLIMIT_AS"), reason="ulimit is for Linux")
def test_a_limit_on_addresses_counts(monkeypatch):
    most = psutil.Process().memory_info().vms + 10**6
    monkeypatch.setattr(psutil.Process, "rlimit", lambda self, kind: (most, most))
    assert cost.available_memory() <= 10**6, "less what is taken already"
