"""What Lightning and torch say that tells a user of a command or of a library function nothing."""

from __future__ import annotations

import logging
import warnings


def silence_libraries() -> None:
    """Drop what the libraries say that tells a user of a command nothing."""
    lightning = (
        f"lightning.pytorch.{name}"
        for name in ("utilities.rank_zero", "trainer.connectors.checkpoint_connector", "accelerators.cuda")
    )
    for name in (*lightning, "torch._subclasses.fake_tensor", "matplotlib"):
        logging.getLogger(name).setLevel(logging.WARNING)
    for message in (
        r".*does not have many workers.*",
        r".*LeafSpec.*",
        r".*`srun` command is available.*",
        r".*module\(s\) in eval mode.*",
        r".*smaller than the logging interval.*",
        r".*Checkpoint directory .* exists and is not empty.*",
        r".*your dataloader is not resumable.*",  # TrainingPosition resumes it
    ):
        warnings.filterwarnings("ignore", message=message)
