"""``python -m sci_lightning.mismatch``: the command of this name."""

from sci_lightning.cli.commands.mismatch import main

if __name__ == "__main__":
    main()
