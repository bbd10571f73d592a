"""``python -m sci_lightning.benchmark``: what decoding one measurement costs here, beside the paper's figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from hydra.core.config_store import ConfigStore
from rich.progress import Progress

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, compose, group_members, plain
from sci_lightning.cli.console import PlainConsole, styled
from sci_lightning.cli.failure_line import one_line
from sci_lightning.configuration.conf_folder import PACKAGE
from sci_lightning.errors import BadInput

SETTINGS = ("frames", "precision", "compile", "warm_up", "repeats", "budget", "product")


def benchmark(composition: Composition) -> None:
    """Write ``benchmark.json`` and ``benchmark.md`` and print the table; a decoder that fails does not stop the others.

    The files are there from the first decoder on, so that an interrupted benchmark keeps what it has measured.

    Args:
        composition: of ``conf/benchmark.yaml``.
    """
    import torch

    from sci_lightning.benchmark.decoder_cost import decoder_cost
    from sci_lightning.benchmark.table import as_markdown, as_table
    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.decoder import kernels
    from sci_lightning.files.atomic_file import atomic_write
    from sci_lightning.runs.device import device_name, resolve_device
    from sci_lightning.runs.precision import describe_precision, resolve_precision
    from sci_lightning.runs.results import write_json

    cfg = composition.cfg
    kernels.use(cfg.kernels)
    out, console, names = Path(cfg.out), PlainConsole(), _names(composition)
    device = resolve_device(cfg.device)
    cfg.precision = resolve_precision(cfg.precision, device)
    console.say(describe_precision(cfg.precision, device))
    if cfg.repeats < 1:
        raise BadInput(f"repeats={cfg.repeats}: at least one call must be timed")
    settings: dict[str, Any] = {key: cfg[key] for key in SETTINGS}
    settings["size"] = (cfg.size, cfg.size) if isinstance(cfg.size, int) else tuple(cfg.size)
    about = {"format": "sci-benchmark", "format_version": 1, "torch": torch.__version__, "device": device_name(device)}
    content: dict[str, Any] = {**about, **settings, "decoders": {}, "failed": {}}
    paper = yaml.safe_load((PACKAGE / "tables" / "paper_figures.yaml").read_text())["decoders"]
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("", total=len(names))
        for name in names:
            progress.update(task, description=name)
            figures = {"paper": paper[name]} if name in paper else {}
            rules = paper[name]["macs_rules"] if name in paper else 2022
            try:
                cost = decoder_cost(_decoder(composition, name), device=str(device), rules=rules, **settings)
                content["decoders"][name] = {**cost, **figures}
            except Exception as error:
                if len(names) == 1:
                    raise
                content["failed"][name] = one_line(error)
            write_json(content, out / "benchmark.json")
            with atomic_write(out / "benchmark.md") as temporary:
                temporary.write_text(as_markdown(content))
            progress.advance(task)
    console.print(as_table(content))
    console.say(styled(out), ": benchmark.json, benchmark.md")
    name = names[0] if len(names) == 1 else "e2e_cnn"
    if name in ("linear", "gap_tv", "admm_tv", "desci"):  # nothing to learn
        print_next(console, invocation("evaluate", f"decoder={name}", "data=synthetic", "size=[64,64]"))
    else:
        print_next(console, invocation("train", "experiment=quickstart", f"decoder={name}"))
    if failed := content["failed"]:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in failed.items())
        raise BadInput(f"{len(failed)} of {len(names)} decoders could not be measured: {reasons}")


def _decoder(composition: Composition, name: str) -> dict[str, Any]:
    """Return the decoder's plain configuration: with its overrides if it was chosen by itself."""
    if name == composition.choice("decoder"):
        return plain(composition.cfg.decoder)
    return plain(compose("benchmark", [f"decoder={name}", f"frames={composition.cfg.frames}"]).cfg.decoder)


def _names(composition: Composition) -> list[str]:
    """Return the decoder that was chosen, or every one of ``conf/decoder`` that ``only`` does not leave out."""
    if composition.choice("decoder") != "all":
        return [composition.choice("decoder")]
    every, cfg = group_members("decoder"), composition.cfg
    if unknown := sorted(set(cfg.only or []) - set(every)):
        raise BadInput(f"only={unknown}: no such decoder; choose from {', '.join(every)}")
    return [name for name in every if cfg.only is None or name in cfg.only]


def main() -> None:
    """Run the command; ``all`` is no file in ``conf/decoder``, whose members are decoders."""
    ConfigStore.instance().store("all", {}, group="decoder")
    run("benchmark", benchmark)


if __name__ == "__main__":
    main()
