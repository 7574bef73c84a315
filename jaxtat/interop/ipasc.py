"""jaxtat behind the interface of IPASC's standardised image reconstruction.

Their base class ``ReconstructionAlgorithm`` reads an IPASC file and calls ``implementation`` for
each record. It is in their repository (IPASC/standardised-image-reconstruction), not in a package:

    class Jaxtat(IpascAlgorithm, ReconstructionAlgorithm):
        pass
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Num

from ..scans import Choices
from .records_on_grid import images_on_grid

SPACING = 5e-4  # [m], by default, as that of their other algorithms


class IpascAlgorithm:
    """``implementation`` and ``get_name``; all records of an instance have one set of choices.

    >>> IpascAlgorithm().get_name()
    'jaxtat'
    """

    _chosen: tuple[np.ndarray, Choices] | None = None

    def get_name(self) -> str:
        """The name under which it is listed."""
        return "jaxtat"

    def implementation(
        self,
        time_series_data: Num[np.ndarray, "detectors samples"],
        detection_elements: Mapping[str, Any],
        sampling_rate: float,
        field_of_view: Float[np.ndarray, "6"],
        *,
        spacing_m: float = SPACING,
        speed_of_sound_m_s: float | None = None,
        choices: Mapping[str, Any] | None = None,
        **others: Any,
    ) -> Float[np.ndarray, "x y z"]:
        """The image of one record.

        Args:
            time_series_data: pressure from time 0.
            detection_elements: with "positions", (detectors, 3) in a coordinate plane [m].
            sampling_rate: [Hz].
            field_of_view: first and last x, y and z [m]; none across that plane.
            spacing_m: of the pixels [m].
            speed_of_sound_m_s: [m/s]; by default that of the file, if ``ipasc_data`` has one, else
                that at which least is unexplained.
            choices: by name as in `scans.choose`, such as ``{"alpha": 1e-3}``.
            others: of their other algorithms, and of what is done before and after: not used.

        Returns:
            (x, y, z), zero outside the region of interest.

        Raises:
            ValueError: for a volume, a field of view without area, and as `scans.choose`.
        """
        if speed_of_sound_m_s is None:
            speed_of_sound_m_s = self._speed_of_file()
        positions = np.asarray(detection_elements["positions"], float)
        ends = np.asarray(field_of_view, float).reshape(3, 2)
        if np.sum(ends[:, 1] - ends[:, 0] >= 3 * spacing_m) != 2:
            raise ValueError(
                f"field_of_view is {np.ravel(ends)}, expected the ends of x, y and z, at least 4 "
                f"pixels of {spacing_m} apart along two of them."
            )
        sizes = np.round((ends[:, 1] - ends[:, 0]) / spacing_m).astype(int) + 1
        axes = [
            a + spacing_m * np.arange(n) if n > 3 else np.array([(a + b) / 2])
            for (a, b), n in zip(ends, sizes, strict=True)
        ]
        earlier = self._chosen
        same = earlier is not None and np.array_equal(earlier[0], positions)
        image, chosen = images_on_grid(
            np.asarray(time_series_data)[None],
            positions,
            sampling_rate,
            speed_of_sound_m_s,
            axes,
            choices or {},
            earlier[1] if earlier is not None and same else None,
        )
        self._chosen = positions, chosen
        return image[0]

    def _speed_of_file(self) -> float | None:
        """The speed of sound that IPASC's base class has read, or None."""
        data = getattr(self, "ipasc_data", None)
        speed = None if data is None else data.get_speed_of_sound()
        return None if speed is None or not np.isfinite(speed) else float(np.mean(speed))
