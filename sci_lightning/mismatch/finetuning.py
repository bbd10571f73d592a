"""``python -m sci_lightning.mismatch.finetuning``: what fine-tuning with the diagnosed camera is worth."""

from sci_lightning.cli.commands.mismatch_finetuning import main

if __name__ == "__main__":
    main()
