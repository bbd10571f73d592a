"""``python -m sci_lightning.export``: a decoder as an ONNX graph, compared with torch and timed beside it."""

from sci_lightning.cli.commands.export import main

if __name__ == "__main__":
    main()
