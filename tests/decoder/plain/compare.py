"""``python -m tests.decoder.plain.compare [NAME ..] [size=128] [calls=3] [train]``: our networks beside plain ones.

Both decode the same measurement (T = 8) with the same weights, of the published size, in turns; the fastest call of
each counts. ``train``: forward and backward instead, with the peak memory of both.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import torch
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.decoder.complexity import count_macs
from tests.decoder.plain.birnat import birnat
from tests.decoder.plain.e2e_cnn import e2e_cnn
from tests.decoder.plain.efficientsci import efficientsci
from tests.decoder.plain.elp_unfolding import elp_unfolding
from tests.decoder.plain.metasci import metasci
from tests.decoder.plain.res2former import res2former
from tests.decoder.plain.revsci import revsci
from tests.decoder.plain.sci3d import sci3d
from tests.decoder.plain.stformer import stformer
from tests.decoder.plain.unet_stages import admm_net, gap_net
from tests.decoder.test_published import as_published
from tests.decoder.test_revsci import Peak

PLAIN: dict[str, Callable[..., list[torch.Tensor]]] = {
    "e2e_cnn": e2e_cnn,
    "metasci": metasci,
    "gap_net": partial(gap_net, squared=False),
    "admm_net": partial(admm_net, squared=False),
    "birnat": birnat,
    "res2former": res2former,
    "res2former_l": res2former,
    "efficientsci": efficientsci,
    "revsci": revsci,
    "stformer": stformer,
    "sci3d": sci3d,
    "elp_unfolding": partial(elp_unfolding, squared=False),
}


def compared(name: str, size: int, calls: int, train: bool) -> str:
    """One line of figures; seconds, GFLOP/s, and the share of the speed of a 4096 x 4096 matrix product."""
    torch.manual_seed(0)
    with initialize_config_dir(str(CONF), version_base="1.3"):
        decoder = instantiate(compose("train", overrides=[f"decoder={name}", "frames=8"]).decoder, _convert_="all")
    state = as_published(decoder)
    if train:  # the same tensors under the other names, with their gradients
        ours = {value.data_ptr(): value for value in decoder.parameters()}
        state = {key: ours.get(value.data_ptr(), value) for key, value in state.items()}
    mask = (torch.rand(8, size, size) < 0.5).float()
    y = (mask * torch.rand(1, 8, size, size)).sum(1)

    def call(network: Callable[[], torch.Tensor]) -> torch.Tensor:
        if not train:
            return network()
        decoder.zero_grad()
        video = network()
        video.square().mean().backward()
        return video.detach()

    networks = {"ours": lambda: decoder(y, mask), "plain": lambda: PLAIN[name](state, y, mask)[-1]}
    seconds: dict[str, list[float]] = {each: [] for each in (*networks, "product")}
    one, other = torch.rand(2, 4096, 4096)
    with torch.inference_mode(not train):
        for _ in range(calls + 1):
            videos = [timed(seconds["ours"], call, networks["ours"]), timed(seconds["plain"], call, networks["plain"])]
            timed(seconds["product"], torch.mm, one, other)
        error = float((videos[0] - videos[1]).abs().max() / videos[1].abs().max())
    best = {each: min(times[1:]) for each, times in seconds.items()}  # the first call warms up
    flops, product = 2e-9 * count_macs(decoder, 8, size, size) * (3 if train else 1), 2e-9 * 4096**3 / best["product"]
    told = ", ".join(
        f"{each} {best[each]:.3f} s ({flops / best[each]:.0f} GFLOP/s, {flops / best[each] / product:.0%} of a product)"
        for each in networks
    )
    memory = ""
    if train:
        peaks = {}
        for each, network in networks.items():
            with Peak() as peak:
                call(network)
            peaks[each] = f"{each} {peak.bytes / 2**20:.0f}"
        memory = f"; peak memory in MiB: {', '.join(peaks.values())}"
    return f"{name}: {told}: {best['plain'] / best['ours']:.2f} times as fast, difference {error:.0e}{memory}"


def timed(seconds: list[float], function: Callable[..., torch.Tensor], *arguments: Any) -> torch.Tensor:
    start = time.perf_counter()
    result = function(*arguments)
    seconds.append(time.perf_counter() - start)
    return result


if __name__ == "__main__":
    given = dict(each.split("=") for each in sys.argv[1:] if "=" in each)
    for chosen in [each for each in sys.argv[1:] if each in PLAIN] or PLAIN:
        print(
            compared(chosen, int(given.get("size", 128)), int(given.get("calls", 3)), "train" in sys.argv), flush=True
        )
