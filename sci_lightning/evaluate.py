"""``python -m sci_lightning.evaluate``: test a trained decoder, or one that needs no training."""

from sci_lightning.cli.commands.evaluate import main

if __name__ == "__main__":
    main()
