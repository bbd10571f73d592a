"""``python -m sci_lightning.reconstruct``: the command of this name."""

from sci_lightning.cli.commands.reconstruct import main

if __name__ == "__main__":
    main()
