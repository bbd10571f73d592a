"""``python -m sci_lightning.virtual_camera``: captures of a camera in which effects are hidden."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("virtual_camera")
