"""Plain words on a command line that stand for settings: ``captures info FILE`` is ``captures info captures=FILE``."""

from __future__ import annotations

import re
from collections.abc import Sequence

from sci_lightning.cli.next_command import override

VALUE_OPTIONS = (
    *("--cfg", "-c", "--info", "-i", "--package", "-p", "--config-dir", "-cd", "--config-name", "-cn"),
    *("--config-path", "-cp", "--shell-completion", "-sc"),
)
"""Options of Hydra that are followed by a value of their own."""


def with_keys(words: Sequence[str], keys: Sequence[str]) -> list[str]:
    """Return a command line in which every plain word is written as a setting, quoted as Hydra takes it.

    Args:
        words: of the command line.
        keys: the settings that plain words stand for, in order. Plain words beyond them stay as they are, and are
            refused where the settings are checked.
    """
    remaining = iter(keys)
    written: list[str] = []
    for before, word in zip(("", *words), words, strict=False):
        # the key of a setting has no slash, but a path may be runs/lr=0.1/report.json
        is_plain = not re.match(r"-|~|\+*[\w.@]+=|hydra/", word)
        if is_plain and before not in VALUE_OPTIONS and (key := next(remaining, None)) is not None:
            word = override(key, word)
        written.append(word)
    return written
