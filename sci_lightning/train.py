"""``python -m sci_lightning.train``: learn a mask and a decoder together, then test them."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("train")
