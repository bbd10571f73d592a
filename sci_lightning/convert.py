"""``python -m sci_lightning.convert``: the command of this name."""

from sci_lightning.cli.commands.convert import main

if __name__ == "__main__":
    main()
