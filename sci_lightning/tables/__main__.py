"""``python -m sci_lightning.tables``: the paper's tables, with what our runs found beside each of its figures."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("tables")
