"""``python -m sci_lightning.export``: the command of this name."""

from sci_lightning.cli.commands.export import main

if __name__ == "__main__":
    main()
