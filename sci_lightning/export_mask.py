"""``python -m sci_lightning.export_mask``: a trained mask as the files that a modulator displays."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("export_mask")
