"""``python -m sci_lightning.export_mask``: a trained mask as the files that a modulator displays."""

from sci_lightning.cli.commands.export_mask import main

if __name__ == "__main__":
    main()
