import numpy as np
from kwave.kgrid import kWaveGrid
from kwave.kmedium import kWaveMedium
from kwave.ksensor import kSensor
from kwave.ksource import kSource
from kwave.kspaceFirstOrder import kspaceFirstOrder

step, speed = 0.15e-3, 1500.0  # m, m/s
grid = kWaveGrid([320, 320], [step, step])
grid.makeTime(speed, t_end=28e-6)
x, y = np.meshgrid(grid.x_vec, grid.y_vec, indexing="ij")

source = kSource()
source.p0 = np.zeros((320, 320))
for x0, y0, radius, value in [
    (3, 2, 4, 1.0),
    (-4, 1, 2.5, 0.6),
    (-1, -5, 1.5, 1.5),
    (1, 1, 1, 1.0),
]:
    source.p0 += value * (np.hypot(x - 1e-3 * x0, y - 1e-3 * y0) < 1e-3 * radius)

angles = np.radians(np.linspace(-45, 225, 256))  # three quarters of a circle of 20 mm
detectors = 0.02 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
sensor = kSensor(mask=detectors.T)
sensor.record = ["p"]
recorded = kspaceFirstOrder(grid, kWaveMedium(sound_speed=speed), source, sensor, quiet=True)
np.savez("record.npz", pressure=recorded["p"], detectors=detectors, times=grid.t_array.ravel())
