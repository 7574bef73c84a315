"""Arrays of known scanners, for files that hold no positions.

Elements are numbered anticlockwise from one end of the opening to the other; an array that counts
clockwise gives the mirror image.
"""

import math
from typing import Any, NamedTuple


class Scanner(NamedTuple):
    """Elements on an arc, focused into its plane.

    Attributes:
        name: of the scanner.
        radius: R_g [m].
        span: the angle from the first element to the last [degrees].
        n_detectors: number of elements.
        sampling_rate: of the record [Hz]; None if the source does not say.
        element_width: of an element along the arc, for `DetectorCurve` [m]; None likewise. Scans
            are reconstructed with point detectors unless a curve is given it.
        source: of these numbers.
    """

    name: str
    radius: float
    span: float
    n_detectors: int
    sampling_rate: float | None
    element_width: float | None
    source: str

    @property
    def positions(self) -> Any:  # the command's help lists scanners, and waits for no NumPy
        """Element k at the angle -90° + (360° - span)/2 + k span/(n - 1): the arc opens downwards.

        Returns:
            NumPy array, (detectors, 3) [m].

        >>> first = SCANNERS["msot-invision-256"].positions[0]
        >>> (1e3 * first).round(2).tolist()  # the scan of PATATO begins at (28.90, -28.37, 0) mm
        [28.9, -28.37, 0.0]
        """
        import numpy as np

        along = np.linspace(-self.span / 2, self.span / 2, self.n_detectors)
        angles = np.radians(90.0 + along)
        x1, x2 = self.radius * np.cos(angles), self.radius * np.sin(angles)
        return np.stack([x1, x2, np.zeros(self.n_detectors)], axis=1)


SCANNERS = {
    "msot-invision-256": Scanner(
        "iThera MSOT inVision 256-TF",
        radius=40.5e-3,
        span=270.0 * 255 / 256,
        n_detectors=256,
        sampling_rate=40e6,
        element_width=0.64e-3,
        source="positions and rate in the public scan of the PATATO project (Scan_9.msot); 256 "
        "elements of 0.64 mm, 40 MHz and a pitch of 0.74 mm (270 degrees in all) in SIMPA, "
        "simpa/core/device_digital_twins/pa_devices/ithera_msot_invision.py",
    ),
    "msot-acuity-echo": Scanner(
        "iThera MSOT Acuity Echo",
        radius=40e-3,
        span=math.degrees(255 * 0.34e-3 / 40e-3),
        n_detectors=256,
        sampling_rate=40e6,
        element_width=0.24e-3,
        source="256 elements of 0.24 mm with a pitch of 0.34 mm on 40 mm, 40 MHz: SIMPA, "
        "simpa/core/device_digital_twins/pa_devices/ithera_msot_acuity.py",
    ),
    "quarter-ring-128": Scanner(
        "128-element quarter ring, University of Connecticut",
        radius=25e-3,
        span=90.0 * 127 / 128,
        n_detectors=128,
        sampling_rate=None,
        element_width=None,
        source="128 elements on a quarter circle of 25 mm: Gamelin et al., J. Biomed. Opt. 13 "
        "(2008) 024007",
    ),
}


def scanner_named(name: str) -> Scanner:
    """The scanner of that name, or ValueError with those that are known."""
    if name not in SCANNERS:
        raise ValueError(f"the scanner is {name!r}, expected one of {', '.join(SCANNERS)}.")
    return SCANNERS[name]
