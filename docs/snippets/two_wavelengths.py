import jax

jax.config.update("jax_enable_x64", True)
import numpy as np

import jaxtat
from jaxtat.io import Scan

radius, c, times = 0.04, 1500.0, np.arange(230) / 4e6
curve = jaxtat.circular_arc(radius, 0.028, 90)
bell = jaxtat.phantoms.Bells([[2e-3, 1e-3]], [4e-3])
radii = np.arange(0.02, 0.06, 2e-4)
g = bell.circular_integrals(curve, radii)
p = jaxtat.records.circular_integrals_to_pressure(g, radii, times, sound_speed=c, model="in-plane")
p = np.asarray(p) + 1e-3 * np.abs(p).max() * np.random.default_rng(0).standard_normal(p.shape)
energies = np.array([50.0, 100.0])  # the second pulse is as much stronger as its image
known = {"detectors": np.pad(curve.points, ((0, 0), (0, 1))), "sampling_rate": 4e6}
known |= {"sound_speed": c, "wavelengths": [700.0, 850.0], "laser_energy": energies}
scan = Scan("pressure", np.stack([50 * p, 100 * 2 * p]), known)

choices = jaxtat.scans.choose(scan, region_radius=0.01, pixels=33, max_frequency=3000.0)
result = jaxtat.scans.reconstruct(scan, choices)
deviation = jaxtat.scans.standard_deviations(scan, choices)
