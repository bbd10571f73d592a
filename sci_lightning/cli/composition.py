"""A command's configuration: composed by Hydra out of ``conf/``, resolved into plain data, built into objects.

:func:`compose` works anywhere, in a notebook as well as inside of a running command.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import hydra
from hydra.conf import HydraConf
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from sci_lightning.cli.failure_line import one_line
from sci_lightning.configuration.build import build
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.errors import BadInput
from sci_lightning.runs.cluster_job import restarts_of_job
from sci_lightning.studies.tables.paper_figures import swept


def _by(key: str, default: Any, cases: Mapping[str, Any], *, _root_: DictConfig) -> Any:
    """Return what ``${by:scale, 64, {cpu:16, smoke:8}}`` stands for: a setting that depends on another one.

    Args:
        key: dotted, of the other setting; of a class, the last part of its name counts.
        default: where the other setting is absent or none of the cases.
        cases: values by those of the other setting.
        _root_: the whole configuration, which OmegaConf hands over.
    """
    return cases.get(str(OmegaConf.select(_root_, key)).rpartition(".")[2], default)


OmegaConf.register_new_resolver("by", _by, replace=True)
OmegaConf.register_new_resolver("swept", swept, replace=True)
OmegaConf.register_new_resolver("restarted", lambda: restarts_of_job() > 0, replace=True)


@dataclass(frozen=True)
class Composition:
    """A composed configuration and how it came about.

    Attributes:
        cfg: the settings, without Hydra's own. Interpolations are resolved when they are read.
        choices: the member that was chosen of each configuration group, ``{"encoder": "lsw_sr", ...}``.
        overrides: of the command line.
        folders: in which configuration files are looked for, ``hydra.searchpath`` included.
        search_path: what the user added to it, ``["file:///home/me/conf"]``.
        writes_folder: whether ``cfg.out`` is a folder of this command's own; else it writes one file, or nothing.
    """

    cfg: DictConfig
    choices: Mapping[str, str]
    overrides: tuple[str, ...] = ()
    folders: tuple[Path, ...] = (CONF,)
    search_path: tuple[str, ...] = ()
    writes_folder: bool = True

    def choice(self, group: str) -> str:
        """Return which member of a configuration group was chosen, such as ``lsw_sr``; ``none`` for no member."""
        return str(self.choices.get(group, "none"))

    def names(self) -> dict[str, str]:
        """Return the chosen members of groups at the top, which a training keeps beside its configuration."""
        return {group: name for group, name in self.choices.items() if "/" not in group}

    def own_folders(self) -> list[str]:
        """Return the override that names the user's folders of configurations again; none without such folders."""
        places = [place if re.fullmatch(r"[\w./:-]+", place) else repr(place) for place in self.search_path]
        return [f"hydra.searchpath=[{','.join(places)}]"] if places else []

    def trusted(self) -> list[str]:
        """Return the override with which a checkpoint of the run may name the user's own classes; none without such."""
        nodes = (self.cfg.get(part) for part in ("encoder", "decoder"))
        parts = [OmegaConf.to_container(node) for node in nodes if OmegaConf.is_config(node)]
        own = {target.partition(".")[0] for target in targets_in(parts)} - {"sci_lightning"}
        names = sorted(own.union(self.cfg.get("trusted") or ()))
        return [f"trusted=[{','.join(names)}]"] if names else []  # quoted it would be a text

    def targets(self, group: str) -> list[str]:
        """Return the ``_target_`` of every member of a configuration group, those in ``hydra.searchpath`` included."""
        files = [file for folder in self.folders for file in sorted((folder / group).glob("*.yaml"))]
        return [str(target) for file in files if (target := OmegaConf.select(OmegaConf.load(file), "_target_"))]


def store_defaults() -> None:
    """Let files of ``conf/`` take defaults that a class states: ``search_defaults`` in their lists."""
    ConfigStore.instance().store("search_defaults", {"search": asdict(SearchSettings())})


@contextmanager
def search_path_checked() -> Iterator[None]:
    """Raise BadInput where Hydra meets a folder of ``hydra.searchpath`` that does not exist, of which it only warns."""
    with warnings.catch_warnings():
        warnings.filterwarnings("error", r"provider=hydra\.searchpath.* is not available")
        try:
            yield
        except UserWarning as missing:
            place = re.sub(r".*path=(.*) is not available.*", r"\1", str(missing))
            raise BadInput(
                f"hydra.searchpath: {place} is no folder here, nor an installed package; "
                "'hydra.searchpath=[file://FOLDER]' takes a folder, absolute or seen from where you are"
            ) from None


@contextmanager
def hydra_of(command: str) -> Iterator[Any]:
    """Yield a Hydra that composes a command; that of the running command is put aside, since there can be one only."""
    store_defaults()
    running = GlobalHydra.instance().hydra
    GlobalHydra.instance().clear()
    try:
        with hydra.initialize_config_dir(str(CONF), job_name=command, version_base="1.3"):
            yield GlobalHydra.instance().hydra
    finally:
        GlobalHydra.instance().clear()
        if running is not None:
            GlobalHydra.instance().initialize(running)


def compose(command: str, overrides: Iterable[str] = ()) -> Composition:
    """Compose the configuration that a command would run with.

    Args:
        command: the name of its file in ``conf/``, such as ``train``.
        overrides: as on the command line, ``["encoder=lsw_sr", "size=[64,64]"]``.

    Raises:
        BadInput: an override that cannot be read, or that chooses or sets what does not exist; with the line that a
            command prints.
    """
    try:
        with hydra_of(command), search_path_checked():
            cfg = hydra.compose(command, list(overrides), return_hydra_config=True)
    except (HydraException, OmegaConfBaseException) as error:
        raise BadInput(one_line(error)) from error
    composition = from_hydra(cfg, cfg.hydra)
    with open_dict(cfg):
        cfg.pop("hydra")
    return composition


def from_hydra(cfg: DictConfig, settings: HydraConf) -> Composition:
    """Return the composition of a configuration, given Hydra's own settings."""
    choices = {str(group): str(choice) for group, choice in settings.runtime.choices.items()}
    sources = [Path(source.path) for source in settings.runtime.config_sources if source.schema == "file"]
    added = [source for source in settings.runtime.config_sources if source.provider not in ("hydra", "main", "schema")]
    search_path = tuple(f"{source.schema}://{source.path}" for source in added)
    overrides = tuple(str(override) for override in settings.overrides.task)
    return Composition(cfg, choices, overrides, tuple(sources), search_path, settings.output_subdir is not None)


def targets_in(content: Any) -> Iterator[str]:
    """Yield every ``_target_`` in plain data."""
    if isinstance(content, Mapping):
        yield from (str(value) for key, value in content.items() if key == "_target_")
    if isinstance(content, (Mapping, list)):
        for value in content.values() if isinstance(content, Mapping) else content:
            yield from targets_in(value)


def group_members(group: str) -> list[str]:
    """Return the names of the members of a configuration group that come with the package, in alphabetical order."""
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


def plain(cfg: DictConfig) -> dict[str, Any]:
    """Return a configuration as resolved dictionaries, lists and values, fit for JSON and checkpoints."""
    content = OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True)
    if not isinstance(content, dict):
        raise TypeError(f"expected a mapping, got {type(content).__name__}")
    return {str(key): value for key, value in content.items()}


def built(cfg: DictConfig, part: str, **more: Any) -> Any:
    """Build what ``cfg`` configures under ``part``, see :func:`~sci_lightning.configuration.build.build`."""
    node = OmegaConf.select(cfg, part)
    if not isinstance(node, DictConfig):
        raise BadInput(f"{part}={node}: expected a mapping with _target_, which names a class")
    return build(plain(node), part, **more)


def in_sweep() -> bool:
    """Return whether this process is running a row of a sweep."""
    return HydraConfig.initialized() and is_row(HydraConfig.get())


def is_row(settings: HydraConf) -> bool:
    """Return whether Hydra's settings are those of a row of a sweep."""
    return settings.mode is RunMode.MULTIRUN and not OmegaConf.is_missing(settings.job, "num")
