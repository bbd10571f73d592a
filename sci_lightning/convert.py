"""``python -m sci_lightning.convert``: published weights into a checkpoint, or a checkpoint into safetensors."""

from sci_lightning.cli.commands.convert import main

if __name__ == "__main__":
    main()
