"""``python -m sci_lightning.mismatch.finetuning``: what fine-tuning with the diagnosed camera is worth."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("mismatch_finetuning")
