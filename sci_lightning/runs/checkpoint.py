"""Checkpoints: written whole, read without executing anything, rebuilt into encoder and decoder."""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from sci_lightning.configuration.build import build_from_file
from sci_lightning.decoder import Decoder
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.effects import Effect
from sci_lightning.encoder.encoder import check_recording
from sci_lightning.encoder.mask import Mask
from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.plain_text import excerpt, with_article
from sci_lightning.runs.checkpoint_archive import check_archive, check_values
from sci_lightning.runs.checkpoint_contents import check_run_config, check_state, checkpoint_digest

NUMPY_NUMBERS = ("f2", "f4", "f8", "i4", "i8", "b1")
"""Types of numpy's numbers in a checkpoint, as pickles call them."""


@dataclass(frozen=True)
class Checkpoint:
    """What a training run left behind.

    Attributes:
        path: of the file.
        config: the run's plain configuration: ``encoder``, ``decoder``, ``frames``, ``size``, ``names``, ...
        state: the system's state, ``encoder.*`` and ``decoder.*`` tensors by name.
        trusted: packages beside this one whose modules its configuration may name.
        resumable: whether it holds the progress of a training; else weights only, to start one from.
    """

    path: Path
    config: dict[str, Any]
    state: dict[str, torch.Tensor]
    trusted: tuple[str, ...] = ()
    resumable: bool = True

    def encoder(self) -> Encoder:
        """The trained encoder, built anew and filled.

        Raises:
            BadInput: the file asks for anything but one of this project's modules, or its state does not fit.
        """
        config = _without_files(self.config["encoder"])
        encoder = build_from_file(config, self.path, "encoder", self.trusted)
        if not isinstance(encoder, Encoder):
            raise BadInput(f"{self.path}: its encoder is {with_article(type(encoder).__name__)}, not an Encoder")
        self.fill("encoder", encoder)
        check_recording(encoder, f"{self.path}: encoder")
        return encoder

    def decoder(self, trainable: bool = False) -> Decoder:
        """The trained decoder, built anew and filled; raises as :meth:`encoder` does.

        Args:
            trainable: as it was built, in training mode, to be trained further; else ready to decode, in evaluation
                mode and without gradients.
        """
        with torch.device("meta"):  # no memory is taken before the shapes are known to fit
            sketch = build_from_file(self.config["decoder"], self.path, "decoder", self.trusted)
        self.check_fit("decoder", sketch)
        decoder = build_from_file(self.config["decoder"], self.path, "decoder", self.trusted)
        if not isinstance(decoder, Decoder):
            raise BadInput(f"{self.path}: its decoder is {with_article(type(decoder).__name__)}, not a Decoder")
        self.fill("decoder", decoder)
        return decoder if trainable else decoder.eval().requires_grad_(False)

    def __repr__(self) -> str:
        """Say in one line what was trained, without the weights."""
        names = self.config.get("names", {})
        return (
            f"Checkpoint({self.path}: {names.get('decoder')} behind {names.get('encoder')}, "
            f"T={self.config.get('frames')}, size {self.config.get('size')}, {len(self.state)} tensors)"
        )

    def fill(self, part: str, module: nn.Module, name: str | None = None) -> None:
        """Load the state of ``part`` ("encoder", "encoder.mask", "decoder", ..) into ``module``, strictly."""
        module.load_state_dict(self.check_fit(part, module, name))
        for key, value in module.state_dict().items():
            if not torch.isfinite(value).all():
                raise BadInput(f"{self.path}: '{part}.{key}' holds NaN or infinite values, expected finite numbers")
        if part.startswith("encoder"):
            self._check_encoder(part, module)

    def _check_encoder(self, part: str, module: nn.Module) -> None:
        """Hold what was filled in to the bounds of what a configuration may say: a blur's width is a loop's length."""
        try:
            for child in module.modules():
                if isinstance(child, Effect):
                    child.check()
                elif isinstance(child, Mask) and not torch.all((child() >= 0) & (child() <= 1)):
                    raise BadInput("a mask beyond 0 to 1 (transmittance)")
        except BadInput as error:
            raise BadInput(f"{self.path}: its {part} holds what no {part} has: {error}") from error

    def check_fit(self, part: str, module: nn.Module, name: str | None = None) -> dict[str, torch.Tensor]:
        """Check that the state of ``part`` fits ``module``, strictly, and return it."""
        state = {key.removeprefix(f"{part}."): value for key, value in self.state.items() if key.startswith(f"{part}.")}
        if misfit := _misfit(state, module.state_dict()):
            trained = self.config["names"][part.split(".")[0]]
            wanted = name or type(module).__name__
            raise BadInput(
                f"{self.path}: a checkpoint of {part}={trained} does not fit {part}={wanted} as configured: {misfit}; "
                f"build the {part} that was trained"
            )
        return state


def read_checkpoint(path: str | Path, trusted: Iterable[str] = ()) -> Checkpoint:
    """Read a checkpoint of this project; ``trusted`` packages beside it may be named by its configuration.

    Raises:
        BadInput: missing, damaged, foreign, or holding anything but tensors and plain values (nothing is executed).
    """
    path = Path(path)
    content = load_file(path)
    if not isinstance(content.get("config"), dict) or not isinstance(content.get("state_dict"), dict):
        raise BadInput(
            f"{path}: not a checkpoint of sci_lightning (no 'config' and 'state_dict' inside); "
            "give RUN/checkpoints/last.ckpt of a training run"
        )
    config, state = content["config"], content["state_dict"]
    check_run_config(path, config)
    check_state(path, state)
    digest = content.get("digest")  # absent in what a notebook has saved
    if digest is not None and digest != checkpoint_digest(config, state):
        raise BadInput(f"{path}: damaged; weights or configuration are not those that were written")
    return Checkpoint(path, config, state, tuple(trusted), "optimizer_states" in content)


def write_weights(path: str | Path, config: Mapping[str, Any], state: Mapping[str, torch.Tensor]) -> None:
    """Write a checkpoint without a training's progress, for ``ckpt_path=`` of evaluate, reconstruct and train.

    Args:
        path: ``.safetensors`` (the configuration is JSON in its metadata), or any other ending for torch's format.
        config: see :class:`Checkpoint`.
        state: likewise.
    """
    digest = checkpoint_digest(config, state)
    with atomic_write(path) as temporary:
        if temporary.suffix == ".safetensors":
            from safetensors.torch import save_file

            apart = {key: value.clone(memory_format=torch.contiguous_format) for key, value in state.items()}
            save_file(apart, temporary, {"config": json.dumps(config), "digest": digest})
        else:
            torch.save({"config": dict(config), "state_dict": dict(state), "digest": digest}, temporary)


def write_checkpoint(path: str | Path, checkpoint: Mapping[str, Any]) -> None:
    """Write a training's checkpoint and its digest; an existing file is replaced only by a complete one.

    Args:
        path: of the file.
        checkpoint: tensors and plain values, among them ``config`` and ``state_dict``.
    """
    digest = checkpoint_digest(checkpoint["config"], checkpoint["state_dict"])
    with atomic_write(path) as temporary:
        torch.save({**checkpoint, "digest": digest}, temporary)


def load_file(path: Path) -> dict[str, Any]:
    """Read a dictionary of tensors and plain values, from torch's format or from safetensors.

    Raises:
        BadInput: missing, damaged, not a dictionary, or holding anything else (nothing is executed).
    """
    if not path.is_file():
        raise BadInput(f"{path}: no such checkpoint; give RUN/checkpoints/last.ckpt of a training run")
    try:
        if path.suffix == ".safetensors":
            return _load_safetensors(path)
        room = check_archive(path)
        with torch.serialization.safe_globals(_numpy_scalars()):
            content = torch.load(path, map_location="cpu", weights_only=True)
        check_values(path, content, room)
    except BadInput:
        raise
    except Exception as error:  # torch raises RuntimeError, EOFError, KeyError, .. on damaged archives
        if isinstance(error, pickle.UnpicklingError) and _is_pickle(path):
            raise BadInput(
                f"{path}: holds Python objects other than tensors and plain values; refused, nothing was executed; "
                "have whoever wrote it save a state_dict instead"
            ) from error
        raise BadInput(f"{path}: not a readable checkpoint, damaged or truncated ({type(error).__name__})") from error
    if not isinstance(content, dict):
        raise BadInput(f"{path}: not a checkpoint (it is {with_article(type(content).__name__)}, not a dictionary)")
    return content


def _is_pickle(path: Path) -> bool:
    """Whether a file begins like a pickle, bare or in torch's archive."""
    with path.open("rb") as file:
        return file.read(2).startswith((b"\x80", b"PK"))


def _load_safetensors(path: Path) -> dict[str, Any]:
    from safetensors import safe_open

    with safe_open(path, framework="pt") as file:
        state = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 (the file is no mapping)
        about = file.metadata() or {}
    if "config" not in about:
        return state
    return {"config": json.loads(about["config"]), "state_dict": state, "digest": about.get("digest")}


class _NumpyType:
    """A NumPy type as it stands in a pickle. A type of numbers only: a file may ask for one of a gigabyte."""

    def __init__(self, name: object, *_: object) -> None:
        if name not in NUMPY_NUMBERS:
            raise pickle.UnpicklingError(f"{excerpt(name)} is no type of numbers")
        self.type = np.dtype(str(name))

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        if state[1] == ">":
            self.type = self.type.newbyteorder(">")


def _numpy_number(kind: _NumpyType, content: bytes) -> Any:
    return np.frombuffer(content, kind.type, 1)[0]


def _numpy_scalars() -> list[Any]:
    """What a numpy number in a checkpoint is made of: published ones carry scores. Plain values, nothing to execute."""
    modules = ("numpy.core.multiarray", "numpy._core.multiarray")  # before and since numpy 2
    return [*((_numpy_number, f"{module}.scalar") for module in modules), (_NumpyType, "numpy.dtype")]


def _misfit(state: Mapping[str, torch.Tensor], wanted: Mapping[str, torch.Tensor]) -> str:
    """The first difference between two states in words, or the empty string."""
    for key in wanted:
        if key not in state:
            return f"'{key}' is missing"
        if state[key].shape != wanted[key].shape:
            return f"'{key}' is {tuple(state[key].shape)}, expected {tuple(wanted[key].shape)}"
    for key in state:
        if key not in wanted:
            return f"'{key}' has no place"
    return ""


def _without_files(config: Any) -> Any:
    """A configuration that reads no file and designs no mask: what these gave is in the state."""
    if isinstance(config, Mapping):
        replaced: dict[str, Any] = {"file": None, "start": "published"}
        return {key: replaced[key] if key in replaced else _without_files(value) for key, value in config.items()}
    if isinstance(config, (list, tuple)):
        return [_without_files(value) for value in config]
    return config
