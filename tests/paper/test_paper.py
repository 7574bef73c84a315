"""``jaxtat paper`` at the paper's size: the table's figures, and every file it promises."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.image import imread

FIGURES = (
    "figure1_geometry.png",
    "figure2_geometry1_disks.png",
    "figure3_geometry2_disks.png",
    "figure4_outside_sources.png",
    "accuracy_geometry1.png",
    "accuracy_geometry2.png",
)


@pytest.fixture(scope="session")
def paper(tmp_path_factory, unoptimised_flags):
    """The command, run once for all tests in a process of its own: (folder, metrics, output)."""
    folder = tmp_path_factory.mktemp("paper")
    command = [sys.executable, "-m", "jaxtat", "paper", "--out", str(folder), "--quiet"]
    environment = os.environ | {"XLA_FLAGS": unoptimised_flags}
    run = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert run.returncode == 0, run.stderr
    return folder, json.loads((folder / "metrics.json").read_text()), run.stdout


@pytest.mark.parametrize(
    ("group", "name", "most"),
    [
        ("geometry1", "smooth_max_error", 1e-8),  # paper 7.3e-5
        ("geometry1", "nyquist_plane_wave_max_error", 1e-7),  # paper 8e-6
        ("geometry2", "smooth_max_error", 3e-5),  # paper "similarly small"
        ("geometry2", "nyquist_plane_wave_max_error", 3e-4),
        ("geometry1", "disks_rel_l2", 0.08),  # Gibbs: the same as classical FBP of exact data
        ("geometry2", "disks_rel_l2", 0.13),
        ("outside_sources", "roi_rel_l2", 2e-3),
        ("geometry1", "peak_memory_mb", 8192),
        ("geometry2", "peak_memory_mb", 8192),
    ],
)
def test_figures_of_the_table(paper, group, name, most):
    assert 0 < paper[1][group][name] <= most


@pytest.mark.parametrize("group", ["geometry1", "geometry2"])
@pytest.mark.parametrize("suffix", ["", "_filtered"])
def test_noise_is_close_to_that_of_classical_back_projection(paper, group, suffix):
    metrics = paper[1][group]
    ratio = metrics[f"noise_std{suffix}"] / metrics[f"fbp_noise_std{suffix}"]
    assert 0.5 < ratio <= 1.2
    # with as many projections as detectors the classical method averages more noise away
    as_many = metrics[f"noise_std{suffix}"] / metrics[f"fbp_noise_std{suffix}_as_many_data"]
    assert ratio < as_many <= 1.4


def test_metrics_hold_every_name_promised(paper):
    names = {
        "nyquist_plane_wave_max_error",
        "smooth_max_error",
        "smooth_rel_l2",
        "disks_rel_l2",
        "noise_std",
        "fbp_noise_std",
        "noise_std_filtered",
        "fbp_noise_std_filtered",
        "plan_seconds",
        "reconstruct_milliseconds",
        "peak_memory_mb",
    }
    for group in ("geometry1", "geometry2"):
        assert names <= paper[1][group].keys()
    assert paper[1]["outside_sources"].keys() == {"roi_rel_l2", "roi_max_error"}


def test_figures_are_written_and_not_blank(paper):
    folder = paper[0]
    assert {path.name for path in folder.iterdir()} == {*FIGURES, "metrics.json"}
    for name in FIGURES:
        pixels = imread(folder / name)
        assert min(pixels.shape[:2]) > 300
        colours = np.round(255 * pixels[..., :3]).astype(int) @ [1 << 16, 1 << 8, 1]
        assert np.unique(colours).size > 20


def test_the_table_sets_paper_beside_here(paper):
    assert "| smooth_max_error | geometry1 | 7.3e-5 |" in paper[2]
    assert "outside_sources" in paper[2]
