"""``python -m sci_lightning.export_mask``: the command of this name."""

from sci_lightning.cli.commands.export_mask import main

if __name__ == "__main__":
    main()
