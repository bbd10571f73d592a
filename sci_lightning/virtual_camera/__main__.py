"""``python -m sci_lightning.virtual_camera``: captures of a camera in which effects are hidden."""

from sci_lightning.cli.commands.virtual_camera import main

if __name__ == "__main__":
    main()
