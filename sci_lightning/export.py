"""``python -m sci_lightning.export``: a decoder as an ONNX graph, compared with torch and timed beside it."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("export")
