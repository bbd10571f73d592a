"""``python -m sci_lightning.convert``: published weights into a checkpoint, or a checkpoint into safetensors."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("convert")
