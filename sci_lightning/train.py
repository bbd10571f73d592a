"""``python -m sci_lightning.train``: the command of this name."""

from sci_lightning.cli.commands.train import main

if __name__ == "__main__":
    main()
