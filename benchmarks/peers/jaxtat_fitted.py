"""jaxtat told what the others are told, the image fitted: f >= 0 and total variation."""

from jaxtat_choices import told

if __name__ == "__main__":
    told(model_based=True)
