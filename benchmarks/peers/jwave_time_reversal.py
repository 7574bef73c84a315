"""jwave: the record as sources, backwards in time, at the grid points where k-Wave plays it.

Its sources are added to the field, they do not replace it: it is the adjoint rather than the time
reversal, up to a factor, which the calibration of images takes away.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jwave.acoustics import simulate_wave_propagation
from jwave.geometry import Domain, Medium, Sources, TimeAxis
from peer import run
from reversal import grid_of, on_image, played

PML = 20


def reconstruct(problem):
    x, times = grid_of(problem)
    mask, record = played(problem, x, times)
    positions = tuple(rows + PML for rows in np.nonzero(mask))
    speed = problem.sound_speed
    domain = Domain((len(x) + 2 * PML,) * 2, (float(x[1] - x[0]),) * 2)
    medium = Medium(domain, sound_speed=speed, pml_size=PML)
    step = float(times[1])
    axis = TimeAxis(step, step * (len(times) - 1) + step / 2)
    signals = jnp.asarray(record[:, ::-1].copy(), jnp.float32)

    @jax.jit
    def solve(signals):
        sources = Sources(positions, signals, step, domain)
        return simulate_wave_propagation(medium, axis, sources=sources).params[-1]

    field = np.asarray(solve(signals), float)[PML:-PML, PML:-PML, 0]
    return on_image(problem, x, field)


if __name__ == "__main__":
    run("jwave", reconstruct)
