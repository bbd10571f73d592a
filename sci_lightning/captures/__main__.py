"""``python -m sci_lightning.captures``: the command of this name."""

from sci_lightning.cli.commands.captures import main

if __name__ == "__main__":
    main()
