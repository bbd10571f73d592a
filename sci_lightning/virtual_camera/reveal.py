"""``python -m sci_lightning.virtual_camera.reveal``: the command of this name."""

from sci_lightning.cli.commands.reveal import main

if __name__ == "__main__":
    main()
