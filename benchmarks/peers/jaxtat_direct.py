"""jaxtat, direct, by its own choices."""

from jaxtat_choices import image_of, refuse_constrained
from peer import run

from jaxtat.scans import integrals
from jaxtat.scans.images import formula_images


def direct(scan, choices, setup):
    refuse_constrained(choices)
    return formula_images(setup, integrals(scan, choices, setup, scan.data), choices, None)


if __name__ == "__main__":
    run("jaxtat", lambda problem: image_of(problem, direct))
