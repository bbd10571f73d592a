"""YAML files of strangers: read as plain data, within bounds."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import yaml

from sci_lightning.errors import BadInput
from sci_lightning.files.bounded_file import read_bounded

MAX_BYTES = 1_000_000
MOST_NODES = 100_000
"""Keys and values; PyYAML takes seconds for so many."""

EXPONENT = re.compile(r"[-+]?[0-9][0-9_]*([eE][-+]?[0-9]+)$")
"""``1e-3``, a number in YAML 1.2 and in Hydra's files, which PyYAML reads as text."""


class _PlainLoader(yaml.SafeLoader):
    """PyYAML's safe loader without aliases, duplicate keys and whole numbers that fill pages."""

    nodes = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self.nodes += 1
        if self.nodes > MOST_NODES:
            raise yaml.YAMLError(f"more than {MOST_NODES:,} keys and values")
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("aliases (*name) are not read: a few lines of them unfold into gigabytes")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        keys = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        if repeated := next((key for key, times in keys.items() if times > 1), None):
            raise yaml.YAMLError(f"the key '{repeated}' stands twice")
        return super().construct_mapping(node, deep)

    def construct_yaml_int(self, node: Any) -> int:
        number = super().construct_yaml_int(node)
        if abs(number) >= 2**63:  # Python neither prints nor hashes long ones in reasonable time
            raise yaml.YAMLError(f"a whole number of {number.bit_length()} bits, at most 63")
        return int(number)


_PlainLoader.add_constructor("tag:yaml.org,2002:int", _PlainLoader.construct_yaml_int)
_PlainLoader.add_implicit_resolver("tag:yaml.org,2002:float", EXPONENT, list("-+0123456789"))


def read_yaml(path: str | Path) -> Any:
    """Read a YAML file into dictionaries, lists and plain values.

    Raises:
        BadInput: missing, unreadable, larger than :data:`MAX_BYTES`, no UTF-8, no YAML, or with aliases, tags or
            repeated keys.
    """
    path = Path(path)
    content = read_bounded(path, MAX_BYTES, "no file that this program writes or reads")
    try:
        return yaml.load(content.decode("utf-8"), _PlainLoader)
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, RecursionError) as error:
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
        reason = " ".join(str(problem or error).split())[:200]
        place = f", line {mark.line + 1}" if mark else ""
        raise BadInput(f"{path}{place}: not a readable YAML file ({reason})") from error
