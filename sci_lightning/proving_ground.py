"""``python -m sci_lightning.proving_ground``: the command of this name."""

from sci_lightning.cli.commands.proving_ground import main

if __name__ == "__main__":
    main()
