"""``python -m sci_lightning``: the commands, with one example each."""

from __future__ import annotations

from sci_lightning.console import PlainConsole, styled

COMMANDS = (
    (
        "train",
        "learn a mask and a decoder together, then test them",
        "encoder=lsw_sr decoder=res2former data=folder data.root=CLIPS",
    ),
    (
        "evaluate",
        "test a trained decoder, with its own encoder or another one",
        "ckpt_path=RUN/checkpoints/last.ckpt encoder=rbw_sr data=benchmark data.root=DIR",
    ),
    (
        "tables",
        "the paper's tables, with what runs found beside each of its figures",
        "runs=outputs/sweep",
    ),
    (
        "diagnose",
        "find the effect that makes captures and model disagree",
        "captures=CAPTURES.h5",
    ),
    (
        "reconstruct",
        "decode a snapshot that a camera took",
        "ckpt_path=RUN/checkpoints/last.ckpt measurement=SNAPSHOT.tiff mask=MASK.mat",
    ),
    (
        "benchmark",
        "parameters, operations, time and memory of a decoder, or of all, beside the paper's figures",
        "decoder=all",
    ),
    (
        "export_mask",
        "a trained mask as the bit planes and frames that a modulator displays",
        "ckpt_path=RUN/checkpoints/last.ckpt canvas=[768,1024]",
    ),
    (
        "convert",
        "make a checkpoint of weights that a network's authors published, or safetensors of a checkpoint",
        "checkpoint=PUBLISHED.pth decoder=res2former out=published.ckpt",
    ),
    (
        "virtual_camera",
        "simulate the calibration captures of a camera in which effects are hidden",
        "out=captures.h5 effects=random seed=5",
    ),
    (
        "virtual_camera.reveal",
        "tell what was hidden, beside what a diagnosis found",
        "captures.truth.json report.json",
    ),
    (
        "diagnosis.proving_ground",
        "count how often a diagnosis names what is hidden in a virtual camera",
        "seeds=1 cases=4",
    ),
    (
        "captures pack",
        "make one captures file of a folder of pictures and its captures.yaml",
        "FOLDER out=captures.h5",
    ),
    (
        "captures info",
        "check a captures file, sum it up and draw its contact sheet",
        "captures.h5",
    ),
)


def main() -> None:
    console = PlainConsole()
    console.say(styled("sci_lightning"), ": design, train and trust a video snapshot compressive imaging camera\n")
    for name, purpose, example in COMMANDS:
        console.say(styled(name), f": {purpose}")
        console.print(f"  python -m sci_lightning.{name} {example}")
    console.print(
        "\nEach takes --help (its configuration and choices); all but captures and reveal also --cfg job (what it "
        "would run with)."
    )


if __name__ == "__main__":
    main()
