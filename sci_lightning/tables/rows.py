"""``python -m sci_lightning.tables.rows``: the command of this name."""

from sci_lightning.cli.commands.tables_rows import main

if __name__ == "__main__":
    main()
