"""``python -m sci_lightning.diagnose``: the command of this name."""

from sci_lightning.cli.commands.diagnose import main

if __name__ == "__main__":
    main()
