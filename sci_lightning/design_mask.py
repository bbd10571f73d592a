"""``python -m sci_lightning.design_mask``: the command of this name."""

from sci_lightning.cli.commands.design_mask import main

if __name__ == "__main__":
    main()
