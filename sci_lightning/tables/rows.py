"""``python -m sci_lightning.tables.rows``: train every row of the paper's tables, and keep the results of each."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("tables_rows")
