"""``python -m sci_lightning.virtual_camera.reveal``: what was hidden, beside what was found."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("reveal")
