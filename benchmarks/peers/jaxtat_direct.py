"""jaxtat told what the others are told, the image by the formula."""

from jaxtat_choices import told

if __name__ == "__main__":
    told(model_based=False)
