"""``python -m sci_lightning.tables.mask_ranking``: scores of many masks, and what a network reaches."""

from sci_lightning.cli.commands.mask_ranking import main

if __name__ == "__main__":
    main()
