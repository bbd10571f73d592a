"""``python -m sci_lightning``: the commands, with one example each."""

from __future__ import annotations

from rich.console import Console

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
    console = Console(highlight=False, soft_wrap=True)
    console.print("[bold]sci_lightning[/]: design, train and trust a video snapshot compressive imaging camera\n")
    for name, purpose, example in COMMANDS:
        console.print(f"[bold]{name}[/]: {purpose}")
        console.print(f"  python -m sci_lightning.{name} {example}", markup=False)
    console.print(
        "\nEach takes --help (its configuration and choices); all but captures also --cfg job (what it would run with)."
    )


if __name__ == "__main__":
    main()
