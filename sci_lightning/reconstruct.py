"""``python -m sci_lightning.reconstruct``: decode a snapshot that a camera took."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("reconstruct")
