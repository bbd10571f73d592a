"""``python -m sci_lightning.tables.mask_ranking``: scores of many masks, and what a network reaches."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("mask_ranking")
