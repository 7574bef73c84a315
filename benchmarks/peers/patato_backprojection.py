"""PATATO: its back-projection of the record's Hilbert transform, the filtered one of its authors.

Time and detectors are not interpolated, as its presets do for scanners: there are enough of both.
"""

from patato_scan import image_of, preprocessed
from peer import run
from sound_in_space import in_space


def reconstruct(problem):
    from patato import ReferenceBackprojection

    record, rate, geometry = preprocessed(in_space(problem), hilbert=True)
    return image_of(problem, ReferenceBackprojection, record, rate, geometry)


if __name__ == "__main__":
    run("patato", reconstruct)
