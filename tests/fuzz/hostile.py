"""What a stranger might write into a file or on a command line: strategies that mutate valid content."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st

CANARY = "executed"
"""A file that exists once any of the hostile content was executed; :func:`tests.fuzz.conftest.alone` looks for it."""

TARGETS = (
    "pathlib.Path.touch",
    "os.mknod",
    "os.system",
    "subprocess.run",
    "shutil.rmtree",
    "numpy.load",
    "torch.load",
    "hydra.utils.instantiate",
    "omegaconf.OmegaConf.load",
    "sympy.sympify",
    "builtins.open",
    "builtins.eval",
    "sci_lightning.runs.checkpoint.Path.touch",
    "sci_lightning.cli.command.run",
    "sci_lightning.encoder.mask.measured.read_mask",
    "sci_lightning.encoder.mask.Measured",
    "sci_lightning.encoder.Encoder",
    "sci_lightning.encoder.effects.Prnu",
    "sci_lightning.decoder.E2ECNN",
    "sci_lightning.decoder.GAP",
    "sci_lightning.training.system.System",
    "torch.nn.Linear",
)
RESOLVED = (
    "${oc.env:HOME}",
    "${oc.create:{_target_:pathlib.Path.touch,_args_:[executed]}}",
    "${oc.decode:${oc.env:HOME}}",
    "${size}",
    "${frames}",
    "${hydra:runtime.cwd}",
    "\\${size}",
    "${",
    "???",
)
TEXTS = (
    "",
    "x",
    "[/]",
    "[bold]",
    "\x1b[2J",
    "../../..",
    "/etc/passwd",
    "$x$",
    "\\input{x}",
    "<script>",
    "nan",
    "é" * 50,
)
NUMBERS = (0, 1, -1, 2, 3, 8, 2**31, 2**63, -(2**63), 10**30, 0.5, -0.0, 1e300, float("nan"), float("inf"))


def targets() -> st.SearchStrategy[dict[str, Any]]:
    """Mappings that ask for something to be called."""
    arguments = st.dictionaries(
        st.sampled_from(["_args_", "_partial_", "_convert_", "_recursive_", "self", "path", "file", "args", "size"]),
        st.sampled_from([[CANARY], CANARY, True, "all", 3]),
        max_size=3,
    )
    return st.builds(lambda name, more: {"_target_": name, **more}, st.sampled_from(TARGETS), arguments)


def values() -> st.SearchStrategy[Any]:
    """Anything that YAML, JSON or a pickle of plain values can hold."""
    scalars = st.one_of(
        st.none(), st.booleans(), st.sampled_from(NUMBERS), st.sampled_from(TEXTS), st.sampled_from(RESOLVED)
    )
    return st.one_of(
        scalars,
        targets(),
        st.lists(st.one_of(scalars, targets()), max_size=4),
        st.dictionaries(st.sampled_from(["_target_", "a", "size", "frames", "defaults"]), scalars, max_size=3),
    )


def mutations(content: Any, keys: st.SearchStrategy[Any], most: int = 3) -> st.SearchStrategy[Any]:
    """Copies of ``content`` with up to ``most`` entries replaced, removed or added, anywhere in it."""
    place = st.integers(0, 10**6)
    step = st.tuples(place, st.sampled_from(["replace", "remove", "add"]), keys, values())
    return st.lists(step, min_size=1, max_size=most).map(lambda steps: _mutated(content, steps))


def _mutated(content: Any, steps: list[tuple[int, str, Any, Any]]) -> Any:
    changed = copy.deepcopy(content)
    for number, what, key, drawn in steps:
        value = copy.deepcopy(drawn)  # strategies hand out the same lists again
        slots: list[tuple[Any, Any]] = []
        _collect(changed, slots.append)
        if not slots:
            break
        owner, at = slots[number % len(slots)]
        if what == "replace":
            owner[at] = value
        elif what == "remove":
            del owner[at]
        elif isinstance(owner, dict):
            owner[key] = value
        else:
            owner.append(value)
    return changed


def _collect(content: Any, keep: Callable[[tuple[Any, Any]], object]) -> None:
    entries = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in entries:
        keep((content, key))
        _collect(value, keep)
