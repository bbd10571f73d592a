"""``python -m sci_lightning.design_mask``: the mask with the best score that a search finds, before any training."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("design_mask")
