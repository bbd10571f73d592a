"""``python -m sci_lightning.evaluate``: the command of this name."""

from sci_lightning.cli.commands.evaluate import main

if __name__ == "__main__":
    main()
