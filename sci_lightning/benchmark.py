"""``python -m sci_lightning.benchmark``: the command of this name."""

from sci_lightning.cli.commands.benchmark import main

if __name__ == "__main__":
    main()
