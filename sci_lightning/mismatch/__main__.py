"""``python -m sci_lightning.mismatch``: what a wrong model of the camera costs, and what a diagnosis wins back."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("mismatch")
