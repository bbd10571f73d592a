"""``python -m sci_lightning.tables.rows``: train every row of the paper's tables, and keep the results of each."""

from sci_lightning.cli.commands.tables_rows import main

if __name__ == "__main__":
    main()
