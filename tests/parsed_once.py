"""Configuration files that Hydra parses once: of a file that has not changed since, every later command gets a copy.

Hydra reads and parses some thirty YAML files for every command. That takes a third of the time of one that is refused.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra._internal.core_plugins.importlib_resources_config_source import ImportlibResourcesConfigSource
from hydra.plugins.config_source import ConfigResult, ConfigSource

Load = Callable[[Any, str], ConfigResult]


def parse_once(folder: Path | None = None) -> None:
    """Let Hydra's two sources of files keep what they have parsed, for the rest of this process and its children.

    Args:
        folder: whose files are parsed at once.
    """
    for source in (FileConfigSource, ImportlibResourcesConfigSource):
        source.load_config = _kept(source.load_config)  # type: ignore[method-assign]
    for file in sorted(folder.rglob("*.yaml")) if folder else ():
        FileConfigSource("main", f"file://{folder.resolve()}").load_config(
            str(file.relative_to(folder).with_suffix(""))
        )


def _kept(load: Load) -> Load:
    parsed: dict[tuple[str, str, Any], ConfigResult] = {}

    def load_config(self: ConfigSource, config_path: str) -> ConfigResult:
        file, changed = os.path.join(self.path.removeprefix("file://"), f"{config_path}.yaml"), None
        if os.path.isfile(file):  # else it comes with Hydra
            stat = os.stat(file)
            changed = stat.st_mtime_ns, stat.st_size, stat.st_ino
        key = self.path, config_path, changed
        if key not in parsed:
            parsed[key] = load(self, config_path)
        return deepcopy(parsed[key])

    return load_config
