"""``python -m sci_lightning.design_mask``: the mask with the best score that a search finds, before any training."""

from sci_lightning.cli.commands.design_mask import main

if __name__ == "__main__":
    main()
