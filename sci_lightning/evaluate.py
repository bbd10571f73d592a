"""``python -m sci_lightning.evaluate``: test a trained decoder, or one that needs no training."""

from __future__ import annotations

from sci_lightning.cli import evaluation
from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition
from sci_lightning.cli.console import PlainConsole, styled


def evaluate(composition: Composition) -> float:
    """Test, write ``metrics.json`` and pictures of the scenes, and print a table; returns the mean PSNR in dB.

    Args:
        composition: of ``conf/evaluate.yaml``.
    """
    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.runs.results import print_results

    cfg, console = composition.cfg, PlainConsole()
    done = evaluation.evaluate(composition, console)
    print_results(done.metrics, console)
    console.say(styled(done.folder), ": metrics.json" + (", pictures/" if done.pictures else ""))
    decodes = {"ckpt_path": cfg.ckpt_path} if cfg.ckpt_path else {}
    decoder_word = [] if decodes else [f"decoder={done.metrics.decoder}"]
    print_next(
        console,
        invocation("tables", paths={"runs": done.folder}),
        invocation("reconstruct", *decoder_word, "measurement=SNAPSHOT.tiff", paths=decodes),
    )
    return done.metrics.mean["psnr"]


if __name__ == "__main__":
    run("evaluate", evaluate)
