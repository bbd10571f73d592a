"""Published weights into our decoders: every key used, or known to be unused; nothing else."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig
from torch import nn

from sci_lightning.decoder import E2ECNN, Decoder, Res2former
from sci_lightning.errors import BadInput
from sci_lightning.weights.published import authors_keys, load_published, our_state, unpack
from tests.conftest import members
from tests.decoder.published_facts import FILES
from tests.decoder.transcriptions import as_published, random_state

State = dict[str, torch.Tensor]
DENOISERS = {"pnp_ffdnet": "ffdnet_gray", "pnp_fastdvdnet": "fastdvdnet_gray"}  # facts are of one iteration


class Merged(Decoder):
    """One layer in the place of three of its authors', and a buffer that they save and we compute."""

    published_names = (
        *((r"qkv\.(.*)", rf"attn.{part}.\1") for part in "qkv"),
        (r"nets\.(\d)\.(\d)\.(.*)", r"stage\2.net\1.\3"),
    )
    published_unused = (r"table\d+",)

    def __init__(self) -> None:
        super().__init__()
        self.qkv = nn.Linear(4, 6)
        self.nets = nn.ModuleDict({"1": nn.ModuleDict({"5": nn.Linear(2, 3)})})


def merged_state() -> State:
    layers = {f"attn.{part}.weight": torch.rand(2, 4) for part in "vkq"}
    layers |= {f"attn.{part}.bias": torch.rand(2) for part in "vkq"}
    return {
        **layers,
        "stage5.net1.weight": torch.rand(3, 2),
        "stage5.net1.bias": torch.rand(3),
        "table12": torch.ones(9),
    }


def test_merged_renamed_and_unused_keys() -> None:
    decoder, state = Merged(), merged_state()
    assert load_published(decoder, state) is None
    assert torch.equal(decoder.qkv.weight, torch.cat([state[f"attn.{part}.weight"] for part in "qkv"]))
    assert torch.equal(decoder.qkv.bias, torch.cat([state[f"attn.{part}.bias"] for part in "qkv"]))
    assert torch.equal(decoder.nets["1"]["5"].weight, state["stage5.net1.weight"])
    assert authors_keys(decoder, "nets.1.5.bias") == ["stage5.net1.bias"]
    state["attn.q.weight"] = torch.rand(2, 5)
    with pytest.raises(BadInput, match=r"'attn.q.weight' \(2, 5\).*\(6, 4\)"):
        load_published(decoder, state)
    del state["attn.q.weight"]
    with pytest.raises(BadInput, match=r"'attn.q.weight' \('qkv.weight' here\) is missing"):
        load_published(decoder, state)


@pytest.fixture
def e2e_state() -> State:
    return random_state(E2ECNN(4, channels=6))


WRAPPED: dict[str, Callable[[State], dict[str, object]]] = {
    "bare": lambda state: state,
    "our own keys": lambda state: our_state(E2ECNN(4, channels=6), state),
    "data-parallel": lambda state: {f"module.{key}": value for key, value in state.items()},
    "compiled": lambda state: {f"_orig_mod.module.{key}": value for key, value in state.items()},
    "dictionary": lambda state: {"epoch": 3, "state_dict": state, "best_psnr": 30.0, "optimizer": {}, "amp": None},
    "cacti": lambda state: {"epoch": 3, "model_state_dict": state, "optim_state_dict": {}},
    "elp": lambda state: {"color_SCI_backward_dict": state, "optimizer": {}, "epoch": 3},
}


@pytest.mark.parametrize("name", WRAPPED)
def test_files_without_a_mask(name: str, e2e_state: State) -> None:
    decoder = E2ECNN(4, channels=6)
    assert load_published(decoder, WRAPPED[name](e2e_state)) is None
    assert all(torch.equal(value, e2e_state[key]) for key, value in as_published(decoder).items())


@pytest.mark.parametrize("prefix", ["", "module."])
def test_the_deep_optics_wrapper(prefix: str, e2e_state: State) -> None:
    decoder, levels, real = E2ECNN(4, channels=6), torch.rand(4, 8, 8), torch.rand(4, 8, 8)
    state = {f"{prefix}encoder.weight": levels, **{f"{prefix}decoder.{key}": each for key, each in e2e_state.items()}}
    mask = load_published(decoder, state)
    assert mask is not None and torch.equal(mask.levels, levels) and mask.real is None
    mask = load_published(decoder, {"pretrain_epoch": 9, "continuous_mask": real, "state_dict": state, "optimizer": {}})
    assert mask is not None and torch.equal(mask.levels, levels) and mask.real is real
    assert all(torch.equal(value, e2e_state[key]) for key, value in as_published(decoder).items())


def test_res2former_alone_is_no_wrapper() -> None:
    """Its own parts are called encoder and decoder, too."""
    decoder = Res2former(8, (1, 1), (2, 4))
    state = random_state(decoder)
    assert load_published(decoder, state) is None
    assert load_published(decoder, {f"decoder.{key}": value for key, value in state.items()}) is None


def test_what_does_not_fit_is_named(e2e_state: State) -> None:
    def message(state: dict[str, object]) -> str:
        with pytest.raises(BadInput) as caught:
            load_published(E2ECNN(4, channels=6), state)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    assert "'fc.weight' has no place in E2ECNN" in message({**e2e_state, "fc.weight": torch.ones(1)})
    assert "'latent.2.bias' is missing" in message({k: v for k, v in e2e_state.items() if k != "latent.2.bias"})
    line = message({key: each for key, each in e2e_state.items() if key != "encode2.conv2.weight"})
    assert "'encode2.conv2.weight' ('encode.1.layers.2.weight' here) is missing" in line
    assert "'conv1.weight' (9, 4, 3, 3): E2ECNN" in message({**e2e_state, "conv1.weight": torch.ones(9, 4, 3, 3)})
    assert "'conv1.weight' is a list" in message({**e2e_state, "conv1.weight": [1.0]})
    assert "'conv1.bias' is in the file twice" in message({"module.conv1.bias": torch.ones(6), **e2e_state})
    assert "'scheduler' beside 'state_dict'" in message({"state_dict": e2e_state, "scheduler": {}})
    wrapper = {"encoder.weight": torch.ones(4, 8, 8), **{f"decoder.{key}": each for key, each in e2e_state.items()}}
    assert "'step' has no place" in message({**wrapper, "step": torch.ones(1)})
    assert "'continuous_mask' is a str" in message({"state_dict": wrapper, "continuous_mask": "none"})
    assert "is missing" in message({})


@pytest.mark.parametrize("name", members("decoder"))
def test_every_published_key_list(name: str, configuration: Callable[..., DictConfig], reference: Path) -> None:
    """Of the published size: tensors that take no memory, each of its own value, all of them in their place."""
    path = reference / f"{DENOISERS.get(name) or FILES.get(name, name)}.json"
    if not path.is_file():
        pytest.skip(f"no facts about {name}")
    listed = json.loads(path.read_text())["state_dict"]
    state = {key: torch.rand(()).to(getattr(torch, kind)).expand(shape) for key, shape, kind in listed}
    with torch.device("meta"):
        decoder = instantiate(configuration("train", f"decoder={name}").decoder, _convert_="all")
    wrapper = {"encoder.weight": torch.rand(8, 4, 4), **{f"decoder.{key}": value for key, value in state.items()}}
    weights, mask = unpack({"pretrain_epoch": 1, "continuous_mask": None, "state_dict": wrapper, "optimizer": {}})
    assert mask is not None and mask.levels is wrapper["encoder.weight"]
    ours = our_state(decoder, weights)
    assert {key: value.shape for key, value in ours.items()} == {k: v.shape for k, v in decoder.state_dict().items()}
    used = sum(value.numel() for value in ours.values())
    spare = [key for key in state if any(re.fullmatch(pattern, key) for pattern in decoder.published_unused)]
    assert used == sum(value.numel() for key, value in state.items() if key not in spare)
    for key in [key for key in state if key not in spare][:20]:
        with pytest.raises(BadInput, match=r"is missing|has .* there"):
            our_state(decoder, {each: value for each, value in state.items() if each != key})
