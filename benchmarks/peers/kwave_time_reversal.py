"""k-Wave: the record played backwards from the grid points next to the detectors.

Its grid has 0.2 mm, or the image's pixels if they are larger. Detectors in a row are joined: the
record is interpolated to all grid points along the curve between them, as k-Wave's own examples do.
"""

from kwave_without_downloads import reverse
from peer import run
from reversal import grid_of, on_image, played

if __name__ == "__main__":

    def reconstruct(problem):
        x, times = grid_of(problem)
        mask, record = played(problem, x, times)
        return on_image(problem, x, reverse(x, times, problem.sound_speed, mask, record))

    run("k-wave-python", reconstruct, compiles=False)
