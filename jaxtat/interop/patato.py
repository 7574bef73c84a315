"""jaxtat as a reconstruction algorithm of PATATO 0.7, under the name "jaxtat".

    import jaxtat.interop.patato

registers it, so that presets of PATATO can name it:

    {"RECONSTRUCTION_ALGORITHM": "jaxtat", "HILBERT_TRANSFORM": false, ...}

Needs PATATO: ``pip install 'jaxtat[patato]'``.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..base.optional_packages import optional
from ..scans import Choices
from .records_on_grid import images_on_grid

recon: Any = optional("patato.recon", "jaxtat.interop.patato", "patato")
NAME = "jaxtat"
_HILBERT = "HILBERT_TRANSFORM"  # PATATO's mark of a record that was made complex, and of its part


class JaxtatReconstruction(recon.ReconstructionAlgorithm):
    """Images by `reconstruct`, with the choices of the first record for all records.

    The record is taken as PATATO's preprocessing left it, energies and impulse response divided out
    if that is requested; everything else is chosen as by `jaxtat reconstruct`. Outside the region
    of interest the image is zero.

    Args:
        n_pixels: (nx, ny, nz), one of them 1.
        field_of_view: (lx, ly, lz), sides [m], or first and last coordinates along each axis.
        kwargs: choices by name as in `scans.choose`, such as ``alpha`` or ``region_radius``; in a
            preset ``RECONSTRUCTION_PARAMS``.
    """

    def __init__(
        self, n_pixels: Sequence[int], field_of_view: Sequence[float], **kwargs: Any
    ) -> None:
        super().__init__(n_pixels, field_of_view, **kwargs)
        self._batch = False  # all wavelengths together: they have one set of choices
        self._chosen: Choices | None = None

    @staticmethod
    def get_algorithm_name() -> str:
        return NAME

    def run(self, time_series: Any, pa_data: Any, *args: Any, **kwargs: Any) -> Any:
        """The reconstruction that PATATO calls; records that are no longer pressure are refused."""
        if time_series.attributes.get(_HILBERT):
            raise ValueError(
                "the record is a Hilbert transform, jaxtat needs the pressure itself: set "
                f"{_HILBERT} to false in the preset, or hilbert=False in the preprocessing."
            )
        return super().run(time_series, pa_data, *args, **kwargs)

    def reconstruct(
        self,
        raw_data: Any,
        fs: float,
        geometry: Any,
        n_pixels: Sequence[int],
        field_of_view: Sequence[float],
        speed_of_sound: float,
        **kwargs: Any,
    ) -> np.ndarray:
        """Images of records.

        Args:
            raw_data: (..., detectors, samples), from time 0.
            fs: sampling rate [Hz].
            geometry: positions, in a coordinate plane, (detectors, 3) [m].
            n_pixels: (nx, ny, nz); 1 across that plane.
            field_of_view: (lx, ly, lz), sides of the image about the origin [m].
            speed_of_sound: [m/s].
            kwargs: choices by name; ``irf`` is PATATO's, whose preprocessing has removed it.

        Returns:
            (..., nz, ny, nx).

        Raises:
            ValueError: for a volume, no speed of sound, and as `scans.choose`.
        """
        if speed_of_sound is None:
            raise ValueError("there is no speed of sound: set it by PAData.set_speed_of_sound.")
        records = np.asarray(raw_data, float)
        axes = [
            np.linspace(-side / 2, side / 2, n) if n > 1 else np.zeros(1)
            for n, side in zip(n_pixels, field_of_view, strict=True)
        ]
        images, self._chosen = images_on_grid(
            records.reshape(-1, *records.shape[-2:]),
            np.asarray(geometry, float),
            fs,
            speed_of_sound,
            axes,
            {name: value for name, value in kwargs.items() if name != "irf"},
            self._chosen,
        )
        stack = images.transpose(0, 3, 2, 1)
        return stack.reshape(*records.shape[:-2], *stack.shape[1:])


if NAME not in recon.RECONSTRUCTION_NAMES:
    recon.RECONSTRUCTION_METHODS.append(JaxtatReconstruction)
    recon.RECONSTRUCTION_NAMES[NAME] = JaxtatReconstruction
