"""``python -m sci_lightning.mismatch.finetuning``: the command of this name."""

from sci_lightning.cli.commands.mismatch_finetuning import main

if __name__ == "__main__":
    main()
