"""``python -m sci_lightning.reconstruct``: decode a snapshot that a camera took."""

from sci_lightning.cli.commands.reconstruct import main

if __name__ == "__main__":
    main()
