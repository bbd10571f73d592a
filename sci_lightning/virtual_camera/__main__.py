"""``python -m sci_lightning.virtual_camera``: the command of this name."""

from sci_lightning.cli.commands.virtual_camera import main

if __name__ == "__main__":
    main()
