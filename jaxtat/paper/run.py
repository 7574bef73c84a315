"""Run all experiments, and write the table, the figures and metrics.json."""

import json
from pathlib import Path

import numpy as np

from ..base.atomic import replacing
from ..base.checks import require_x64
from .cases import paper_cases
from .experiments import outside_sources, run_case
from .figures import draw_all

Metrics = dict[str, dict[str, float]]

# what the paper says of the same quantity; None where it gives words, which stand beside
_PAPER = {
    ("geometry1", "nyquist_plane_wave_max_error"): "8e-6",
    ("geometry1", "smooth_max_error"): "7.3e-5",
    ("geometry2", "smooth_max_error"): '"similarly small"',
    ("geometry1", "noise_std / fbp_noise_std"): '"quite close"',
    ("geometry2", "noise_std / fbp_noise_std"): '"quite close"',
    ("geometry1", "plan_seconds"): '"several hours"',
}


def run_paper(out: str | Path, *, progress: bool = True) -> Metrics:
    """Repeat section 4 of the paper at its own size and write all of it into a folder.

    Args:
        out: folder, made if need be: figures as PNG and metrics.json.
        progress: show progress bars.

    Returns:
        What metrics.json holds, by geometry and quantity.
    """
    require_x64()
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    cases = paper_cases()
    first, second = (run_case(case, progress) for case in cases)
    metrics = {results.case.name: results.metrics for results in (first, second)}
    metrics["outside_sources"] = outside_sources(second, cases[0].smooth)
    draw_all(first, second, folder)
    with replacing(folder / "metrics.json") as temporary:
        temporary.write_text(json.dumps(metrics, indent=2) + "\n")
    return metrics


def paper_table(metrics: Metrics) -> str:
    """The paper's numbers beside those of jaxtat, as a Markdown table.

    >>> print(paper_table({"geometry1": {"smooth_max_error": 4.5e-8}}))
    | quantity | geometry | paper | here |
    | --- | --- | --- | --- |
    | smooth_max_error | geometry1 | 7.3e-5 | 4.5e-08 |
    """
    lines = ["| quantity | geometry | paper | here |", "| --- | --- | --- | --- |"]
    for geometry, values in metrics.items():
        for name, value in {**values, **_noise_ratios(values)}.items():
            paper = _PAPER.get((geometry, name), "")
            lines.append(f"| {name} | {geometry} | {paper} | {value:.3g} |".replace("|  |", "| |"))
    return "\n".join(lines)


def _noise_ratios(values: dict[str, float]) -> dict[str, float]:
    pairs = [("noise_std", "fbp_noise_std"), ("noise_std_filtered", "fbp_noise_std_filtered")]
    return {
        f"{ours} / {classical}": float(np.divide(values[ours], values[classical]))
        for ours, classical in pairs
        if ours in values
    }
