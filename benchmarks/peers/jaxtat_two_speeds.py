"""jaxtat with two speeds of sound: told the water's, it finds the body and its speed."""

from jaxtat_choices import image_of
from peer import run

from jaxtat import __version__

if __name__ == "__main__":
    run(
        "jaxtat",
        lambda problem: image_of(problem, two_speeds=True, water_speed=problem.water_speed),
        version=__version__,
    )
