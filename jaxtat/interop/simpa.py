"""jaxtat as a reconstruction of SIMPA: the last step of a simulation, on the record in its file.

    settings.set_reconstruction_settings({Tags.SPACING_MM: 0.2, "jaxtat": {"alpha": 1e-3}})
    simulate([..., JaxtatAdapter(settings)], settings, device)

Needs SIMPA 1.0 and, by it, PyTorch: ``pip install 'jaxtat[simpa]'``.
"""

from typing import Any

import numpy as np

from ..base.optional_packages import optional
from .records_on_grid import images_on_grid

modules: Any = optional(
    "simpa.core.simulation_modules.reconstruction_module", "jaxtat.interop.simpa", "simpa"
)
files: Any = optional("simpa.io_handling", "jaxtat.interop.simpa", "simpa")
Tags: Any = optional("simpa.utils", "jaxtat.interop.simpa", "simpa").Tags
CHOICES = "jaxtat"  # under which the reconstruction settings hold choices by name


class JaxtatAdapter(modules.ReconstructionAdapterBase):
    """The image of a record by `reconstruct`, in the field of view of SIMPA's device.

    Read from SIMPA's settings are ``SPACING_MM``, ``K_WAVE_SPECIFIC_DT`` (else the device's
    sampling rate), ``DATA_FIELD_SPEED_OF_SOUND`` (else the mean of the simulated one, if
    ``WAVELENGTH`` says of which), and under "jaxtat" choices by name as in `scans.choose`. All else
    is chosen as by `jaxtat reconstruct`. Outside the region of interest the image is zero.
    """

    def reconstruction_algorithm(
        self, time_series_sensor_data: Any, detection_geometry: Any
    ) -> np.ndarray:
        """The image of one record.

        Args:
            time_series_sensor_data: (elements, samples), pressure from time 0.
            detection_geometry: SIMPA's, its elements in a plane of constant y.

        Returns:
            (x, z), as SIMPA's own reconstructions.

        Raises:
            ValueError: for detectors around a volume, no spacing, and as `scans.choose`.
        """
        positions = 1e-3 * detection_geometry.get_detector_element_positions_base_mm()
        extent = 1e-3 * np.asarray(detection_geometry.field_of_view_extent_mm, float)
        step = 1e-3 * self._spacing()
        axes = [_nodes(a, b, step) for a, b in extent.reshape(3, 2)]
        image, _ = images_on_grid(
            np.asarray(time_series_sensor_data)[None],
            np.asarray(positions, float),
            self._sampling_rate(detection_geometry),
            self._speed_of_sound(),
            axes,
            dict(_of(self.component_settings, CHOICES) or {}),
        )
        return image[0].squeeze()

    def _spacing(self) -> float:
        """Spacing of the pixels [mm]."""
        for settings in (self.component_settings, self.global_settings):
            if _of(settings, Tags.SPACING_MM):
                return float(settings[Tags.SPACING_MM])
        raise ValueError("there is no spacing of pixels: set Tags.SPACING_MM.")

    def _sampling_rate(self, geometry: Any) -> float:
        """Sampling rate [Hz]."""
        step = _of(self.global_settings, Tags.K_WAVE_SPECIFIC_DT)
        return 1 / float(step) if step else 1e6 * float(geometry.sampling_frequency_MHz)

    def _speed_of_sound(self) -> float | None:
        """Speed of sound [m/s], or None to estimate it."""
        name = Tags.DATA_FIELD_SPEED_OF_SOUND
        if _of(self.component_settings, name):
            return float(self.component_settings[name])
        if not _of(self.global_settings, Tags.WAVELENGTH):
            return None
        path = self.global_settings[Tags.SIMPA_OUTPUT_FILE_PATH]
        return float(np.mean(files.load_data_field(path, name)))


def _of(settings: Any, tag: Any) -> Any:
    """A setting, or None. SIMPA's dictionaries are indexed by its tags; their ``get`` is not."""
    return settings[tag] if tag in settings else None  # noqa: SIM401


def _nodes(start: float, end: float, step: float) -> np.ndarray:
    """Nodes symmetric about the middle, as many as SIMPA's pixels."""
    n = max(round(abs(end - start) / step), 1)
    return (start + end) / 2 + step * (np.arange(n) - (n - 1) / 2)
