"""The generated part of the reference: directives that write down what the package says of itself.

``{commands}`` lists every command with its settings, ``{groups}`` every choice of the configuration, ``{effects}``
every effect with its parameters and what it does to a snapshot, ``{formats}`` every JSON format, ``{library}`` the face
of the library. None takes an argument; each stands alone on a page of ``docs/reference/``.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

import torch
from docutils import nodes
from omegaconf import OmegaConf
from pydantic import BaseModel, TypeAdapter
from pydantic.errors import PydanticUserError
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import sci_lightning as sci
from sci_lightning.__main__ import EXAMPLES
from sci_lightning.cli.help import Setting, dataclass_settings, first_comment, read_defaults, read_settings
from sci_lightning.cli.settings import settings_of
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.encoder.effects import Effect
from sci_lightning.encoder.effects.stage import STAGES
from sci_lightning.files.diagnosis_report import DiagnosisReport, SnapshotFacts
from sci_lightning.files.modulator_files import Planes
from sci_lightning.runs.results import RunMetrics
from sci_lightning.studies.benchmark.benchmark_file import Benchmark
from sci_lightning.studies.tables.documented import Measurements
from sci_lightning.virtual_camera.truth import Truth

PICTURES = Path(__file__).parent.parent / "_build" / "effects"
FORMATS: Mapping[str, tuple[type[BaseModel], str]] = {
    "metrics.json": (RunMetrics, "what `train` and `evaluate` leave"),
    "report.json": (DiagnosisReport, "what `diagnose` leaves"),
    "snapshots.json": (SnapshotFacts, "what snapshots alone say, beside `report.json`"),
    "captures.truth.json": (Truth, "what a virtual camera hides"),
    "planes.json": (Planes, "which bit planes `export_mask` wrote, and when each is shown"),
    "benchmark.json": (Benchmark, "what `benchmark` leaves"),
    "docs/results/*.json": (Measurements, "the measured tables of this site"),
}
GROUPS = ("encoder", "encoder/mask", "encoder/sensor", "decoder", "data", "metric", "effect")
GROUPS += ("experiment", "scale", "trainer", "logger", "hydra/launcher", "hparams_search")
SIDE, SLOTS = 96, 8


def table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a Markdown table."""
    lines = [heads, tuple("---" for _ in heads), *rows]
    cells = [[cell.replace("|", "\\|") for cell in line] for line in lines]
    return "\n".join(f"| {' | '.join(line)} |" for line in cells) + "\n"


def commands() -> Iterator[str]:
    """Describe every command: what it is for, an example, its settings with their types and defaults."""
    for name, example in EXAMPLES.items():
        text = (CONF / f"{_configuration(name)}.yaml").read_text()
        types, files = settings_of(_configuration(name)), read_settings(text)
        yield f"## {name}\n\n{_purpose(text)}\n\n```bash\npython -m sci_lightning.{name} {example}\n```\n"
        groups = [default for default in read_defaults(text) if (CONF / default.key.partition("@")[0]).is_dir()]
        shown = [one for one in groups if one.key.partition("@")[0] in GROUPS]
        if shown:
            yield f"Groups: {', '.join(f'[`{one.key}={one.value}`](groups.md#{_anchor(one.key)})' for one in shown)}.\n"
        rows = [(f"`{one.key}`", f"`{one.value}`", _kind(types.get(one.key)), one.about) for one in files]
        for key in (default for default in types if f"- {default}_defaults" in text):
            rows += [(f"`{one.key}`", f"`{one.value}`", "", one.about) for one in dataclass_settings(key, types[key])]
        yield table(("setting", "default", "values", "meaning"), rows)


def groups() -> Iterator[str]:
    """Describe every choice of every group, with the settings that its file has."""
    for group in GROUPS:
        yield f"## {group}\n"
        for path in sorted((CONF / group).glob("*.yaml")):
            text = path.read_text()
            yield f"### {group}={path.stem}\n\n{first_comment(text)}\n"
            own: list[Setting] = [one for one in read_settings(text) if "_target_" not in one.key]
            rows = [(f"`{one.key}`", f"`{one.value}`", one.about) for one in [*read_defaults(text), *own]]
            if rows and group not in ("effect", "experiment"):
                yield table(("setting", "value", "meaning"), rows)


def effects() -> Iterator[str]:
    """Describe every effect, stage by stage, in the order in which light meets them."""
    known = sorted(vocabulary().values(), key=lambda effect: effect.rank)
    targets = "Targets that are not quite what the file says: errors of the laboratory, never part of an encoder."
    for stage, base in {**STAGES, "scene": None}.items():
        about = inspect.cleandoc(base.__doc__ or "").partition("\n\nArgs")[0] if base else targets
        yield f"## {stage}\n\n{_markdown(about)}\n"
        for effect in known:
            if effect.stage == stage:
                about = inspect.cleandoc(effect.__doc__ or "").partition("Args:")[0]
                yield f"### {effect.name}\n\n{_markdown(about)}\n"
                yield table(("parameter", "unit", "range", "does nothing at"), list(_parameters(effect)))
                if (picture := _picture(effect)) is not None:
                    yield f"![A snapshot without and with {effect.name}, and the difference]({picture})\n"


def formats() -> Iterator[str]:
    """Describe every JSON format by its model: keys, types, meaning."""
    for name, (model, about) in FORMATS.items():
        version = get_args(model.model_fields["format_version"].annotation)
        of = f", `format` {get_args(model.model_fields['format'].annotation)[0]!r}, version {version[-1]}"
        yield f"## {name}\n\n{about[0].upper()}{about[1:]}{of}.\n"
        shown: list[type[BaseModel]] = []
        waiting = [model]
        while waiting:
            one = waiting.pop(0)
            if one in shown:
                continue
            shown.append(one)
            if one is not model:
                yield f"**{one.__name__}**\n"
            rows = []
            for key, field in one.model_fields.items():
                kind = inspect.formatannotation(field.annotation).replace("sci_lightning.", "")
                rows.append((f"`{field.alias or key}`", f"`{kind.rpartition('.')[2] if '[' not in kind else kind}`"))
                rows[-1] += (field.description or "",)
                waiting += [inner for inner in _inner(field.annotation) if issubclass(inner, BaseModel)]
            yield table(("key", "type", "meaning"), rows)


def library() -> Iterator[str]:
    """Describe what ``import sci_lightning as sci`` offers, from its docstrings."""
    for name in sorted(sci.PUBLIC_NAMES, key=str.lower):
        thing = getattr(sci, name)
        if inspect.ismodule(thing):
            about = inspect.cleandoc(thing.__doc__ or "").partition("\n\n")[0]
            members = [each for each in getattr(thing, "__all__", []) if inspect.isclass(getattr(thing, each, None))]
            listed = ", ".join(f"`{each}`" for each in sorted(members))
            yield f"## sci.{name}\n\n{_markdown(about)}\n\n{listed}\n"
            continue
        kind = "autoclass" if inspect.isclass(thing) else "autofunction"
        place = f"{thing.__module__}.{thing.__qualname__}"
        options = ":members:\n" if kind == "autoclass" and not issubclass(thing, torch.nn.Module) else ""
        if kind == "autoclass" and issubclass(thing, Exception):
            options = ""
        yield f"## sci.{name}\n\n```{{eval-rst}}\n.. {kind}:: {place}\n"
        yield "".join(f"   {line}\n" for line in options.splitlines()) + "```\n"


def _configuration(command: str) -> str:
    """Return the name of a command's file in ``conf/``."""
    return command.replace(" ", "_").rpartition(".")[2]


def _purpose(text: str) -> str:
    purpose = text.partition("\n")[0].partition(": ")[2]
    return f"{purpose[0].upper()}{purpose[1:]}."


def _anchor(group: str) -> str:
    return group.partition("@")[0].replace("/", "")


def _kind(annotation: Any) -> str:
    """Return in words which values an annotation takes."""
    if annotation is None:
        return ""
    try:
        schema = TypeAdapter(annotation).json_schema()
    except (PydanticUserError, TypeError, ValueError):
        return ""
    return ", ".join(dict.fromkeys(word for one in schema.get("anyOf", [schema]) if (word := _word(one))))


def _word(schema: Mapping[str, Any]) -> str:
    if "enum" in schema or "const" in schema:
        return ", ".join(map(str, schema.get("enum", [schema.get("const")])))
    names = {"integer": "whole number", "number": "number", "boolean": "true, false", "string": "text", "null": "null"}
    word = names.get(schema.get("type", ""), {"array": "list", "object": "mapping"}.get(schema.get("type", ""), ""))
    low, high = schema.get("minimum"), schema.get("maximum")
    if schema.get("type") in ("integer", "number") and low is not None and high is not None and high < 1e9:
        return f"{word} {low:g} to {high:g}"
    return f"{word} from {low:g}" if low is not None else word


def _parameters(effect: type[Effect]) -> Iterator[tuple[str, ...]]:
    for name, about in effect.about.items():
        span = f"{about.low:g} to {about.high:g}"
        if about.choices:
            few = len(about.choices) < 12
            span = ", ".join(map(str, about.choices)) if few else f"{about.choices[0]} to {about.choices[-1]}, whole"
        yield f"`{name}`", about.unit, span, "" if about.neutral is None else f"{about.neutral}"


def _markdown(text: str) -> str:
    """Return a docstring as Markdown: literals in single backquotes, roles as literals, one paragraph a line."""
    text = re.sub(r":math:`([^`]+)`", r"$\1$", text)
    text = re.sub(r":\w+:`~?\.?([^`]+)`", lambda role: f"`{role[1].rpartition('.')[2]}`", text).replace("``", "`")
    return "\n\n".join(
        "\n".join(f"    {line}" for line in part.splitlines()) if part.startswith("    ") else " ".join(part.split())
        for part in text.strip("\n").split("\n\n")
    )


def _inner(annotation: Any) -> Iterator[type]:
    """Yield the classes within an annotation."""
    if inspect.isclass(annotation) and not get_args(annotation):
        yield annotation
    for part in get_args(annotation):
        yield from _inner(part)


def _picture(effect: type[Effect]) -> str | None:
    """Draw what an effect does to a snapshot; return the picture's path within the site.

    None for one that has no file, or does nothing by itself.
    """
    file = CONF / "effect" / f"{effect.name}.yaml"
    if not file.is_file():
        return None
    import matplotlib.pyplot as plt

    values = OmegaConf.to_container(OmegaConf.load(file), resolve=False)
    assert isinstance(values, dict)
    known = {"${size}": (SIDE, SIDE), "${seed}": 0, "${frames}": SLOTS}
    arguments = {key: known.get(value, value) for key, value in values.items() if key != "_target_"}
    mask = sci.masks.RandomStructural(bits=4, frames=SLOTS, size=(SIDE, SIDE), seed=0)
    sensor = sci.sensors.ClipQuantise(bit_depth=8)
    with torch.no_grad():
        torch.manual_seed(0)
        without = sci.Encoder(mask, sensor)(_scene())[0]
        torch.manual_seed(0)
        changed = sci.Encoder(mask, sensor, effects=[effect(**arguments)])(_scene())[0]
    difference = 255 * (changed - without)
    if not bool(difference.any()):
        return None
    figure, axes = plt.subplots(1, 3, figsize=(7.2, 2.6), layout="constrained")
    limit = max(float(difference.abs().quantile(0.995)), 1.0)
    for axis, image, title in zip(axes, (without, changed), ("ideal", effect.name), strict=False):
        axis.imshow(image, cmap="gray", vmin=0, vmax=1)
        axis.set_title(title, fontsize=9)
    shown = axes[2].imshow(difference, cmap="coolwarm", vmin=-limit, vmax=limit)
    axes[2].set_title("difference (DN)", fontsize=9)
    figure.colorbar(shown, ax=axes[2], shrink=0.85).ax.tick_params(labelsize=7)
    for axis in axes:
        axis.set_axis_off()
    PICTURES.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURES / f"{effect.name}.png", dpi=110)
    plt.close(figure)
    return f"/_build/effects/{effect.name}.png"


def _scene() -> torch.Tensor:
    """Return frames ``(1, T, H, W)`` of a photograph that moves to the right by two pixels a slot."""
    from skimage.data import camera

    picture = torch.from_numpy(camera()).float() / 255
    rows = slice(60, 60 + 2 * SIDE, 2)
    frames = [picture[rows, 200 - 4 * slot : 200 - 4 * slot + 2 * SIDE : 2] for slot in range(SLOTS)]
    return torch.stack(frames)[None]


def _directive(write: Callable[[], Iterator[str]]) -> type[SphinxDirective]:
    class Generated(SphinxDirective):
        """A directive that stands for what ``write`` yields, Markdown."""

        def run(self) -> list[nodes.Node]:
            return self.parse_text_to_nodes("\n".join(write()), allow_section_headings=True)

    return Generated


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directives to the site."""
    for write in (commands, groups, effects, formats, library):
        app.add_directive(write.__name__, _directive(write))
    return {"parallel_read_safe": True}
