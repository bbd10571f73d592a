"""``python -m sci_lightning.tables``: the command of this name."""

from sci_lightning.cli.commands.tables import main

if __name__ == "__main__":
    main()
