"""jaxtat, direct, by its own choices."""

from jaxtat_all_frequencies import direct
from jaxtat_choices import image_of
from peer import NotForThis, run


def of_its_choice(scan, choices, setup):
    if choices.model_based:
        raise NotForThis("jaxtat itself takes the model-based fit here")
    return direct(scan, choices, setup)


if __name__ == "__main__":
    run("jaxtat", lambda problem: image_of(problem, of_its_choice))
