"""PATATO: its back-projection of the record's Hilbert transform, the filtered one of its authors.

Filters are left at none, time and detectors are not interpolated: the record has no noise outside
the band of the image, and as many detectors as the array has.
"""

from patato_scan import image_of, preprocessed
from peer import run


def reconstruct(problem):
    from patato import ReferenceBackprojection

    record, rate, geometry = preprocessed(problem, hilbert=True)
    return image_of(problem, ReferenceBackprojection, record, rate, geometry)


if __name__ == "__main__":
    run("patato", reconstruct)
