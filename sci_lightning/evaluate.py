"""``python -m sci_lightning.evaluate``: test a trained decoder, or one that needs no training."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("evaluate")
