"""``python -m sci_lightning.tables.mask_ranking``: the command of this name."""

from sci_lightning.cli.commands.mask_ranking import main

if __name__ == "__main__":
    main()
