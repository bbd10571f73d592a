"""``python -m sci_lightning``: the commands, with one example each."""

from __future__ import annotations

import sys
from difflib import get_close_matches
from runpy import run_module

from sci_lightning.cli.start import output_may_be_cut_off
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.console import PlainConsole, styled
from sci_lightning.plain_text import one_printable_line

EXAMPLES = {
    "demo": "",
    "train": "encoder=lsw_sr decoder=res2former data=folder data.root=CLIPS",
    "evaluate": "ckpt_path=RUN/checkpoints/last.ckpt encoder=rbw_sr data=six_scenes data.root=DIR",
    "tables": "runs=outputs/sweep",
    "diagnose": "captures=CAPTURES.h5",
    "reconstruct": "measurement=SNAPSHOT.tiff mask=MASK.mat",
    "benchmark": "decoder=all",
    "design_mask": "bits=4 frames=8 full_well=10000",
    "export_mask": "ckpt_path=RUN/checkpoints/last.ckpt 'canvas=[768,1024]'",
    "export": "ckpt_path=RUN/checkpoints/last.ckpt out=model.onnx",
    "convert": "checkpoint=PUBLISHED.pth decoder=res2former out=published.ckpt",
    "virtual_camera": "out=captures.h5 effects=random seed=5",
    "virtual_camera.reveal": "captures.truth.json report.json",
    "proving_ground": "seeds=1 cases=4",
    "mismatch": "decoder=gap_tv,linear data.root=DIR",
    "captures plan": "out=SESSION",
    "captures pack": "FOLDER out=captures.h5",
    "captures register": "captures.h5",
    "captures info": "captures.h5",
}
"""Arguments of every command that is listed, as an example; what it is for stands on top of its file in ``conf/``."""

PROGRAMS = dict.fromkeys(name.partition(" ")[0] for name in EXAMPLES)
"""What can follow ``sci-lightning``, in order: each is a module of the package."""

COMPLETION = r"""if [ -n "$ZSH_VERSION" ]; then
  autoload -U +X compinit bashcompinit && { type compdef > /dev/null || compinit; } && bashcompinit
fi
_sci_lightning() {
  [[ -n "$ZSH_VERSION" ]] && emulate -L ksh
  local words=($COMP_LINE) word="${COMP_WORDS[COMP_CWORD]}" choices
  if (( COMP_CWORD < 2 )); then
    choices="$(sci-lightning commands)"
  elif [[ ${words[1]} == captures ]]; then
    choices=""
    (( COMP_CWORD == 2 )) && choices="plan pack register info"
  else
    choices="$(COMP_LINE="sci-lightning ${COMP_LINE#* * }" sci-lightning "${words[1]}" -sc query=bash 2>/dev/null)"
  fi
  COMPREPLY=($(compgen -o nospace -o default -W "$choices" -- "$word"))
}
COMP_WORDBREAKS=${COMP_WORDBREAKS//=}
complete -o nospace -o default -F _sci_lightning sci-lightning"""
"""For bash, and for zsh in its way of bash: commands first, then what Hydra knows of the command's settings."""

FISH = r"""function _sci_lightning
  set -l words (commandline -cpo) (commandline -ct)
  if test (count $words) -lt 3
    sci-lightning commands | string split ' '
  else if test $words[2] != captures
    COMP_LINE="$words[1] $words[3..]" sci-lightning $words[2] -sc query=fish 2>/dev/null
  else if test (count $words) -eq 3
    string split ' ' 'plan pack register info'
  end
end
complete -c sci-lightning -a '(_sci_lightning)'"""
"""The same for fish."""


def main() -> None:
    """Run ``sci-lightning COMMAND ...``, which is ``python -m sci_lightning.COMMAND ...``."""
    with output_may_be_cut_off():
        _main()


def _main() -> None:
    name, *arguments = sys.argv[1:] or ["--help"]
    name = name.replace("-", "_") if not name.startswith("-") else name
    if name in ("--help", "-h", "help"):
        print_commands()
    elif name == "commands":
        print(" ".join(PROGRAMS))
    elif name == "completion":
        print(FISH if arguments == ["fish"] else COMPLETION)
    elif name not in PROGRAMS:
        near = get_close_matches(name, PROGRAMS, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]}?" if near else f"choose one of {', '.join(PROGRAMS)}"
        print(f"error: {one_printable_line(name)}: no such command; {hint}", file=sys.stderr)
        sys.exit(2)
    else:
        sys.argv = [f"sci_lightning.{name}", *arguments]
        if not getattr(sys.flags, "safe_path", False):
            sys.path.insert(0, "")  # modules of the user's own in the current folder, as `python -m` has it
        # as `python -m` does it, so that processes which this one starts are started in the same way
        run_module(f"sci_lightning.{name}", run_name="__main__", alter_sys=True)


def print_commands() -> None:
    """Print every command with its purpose and an example."""
    console = PlainConsole()
    console.say(styled("sci_lightning"), ": design, train and trust a video snapshot compressive imaging camera\n")
    for name, example in EXAMPLES.items():
        file = CONF / f"{name.replace(' ', '_').rpartition('.')[2]}.yaml"
        purpose = file.read_text().partition("\n")[0].partition(": ")[2]
        console.say(styled(name), f": {purpose}")
        console.print(f"  python -m sci_lightning.{name} {example}".rstrip())
    console.print(
        "\nEach takes --help (its configuration and choices) and --cfg job (what it would run with).\n"
        'sci-lightning COMMAND is the same; eval "$(sci-lightning completion)" completes it in bash and zsh.'
    )


if __name__ == "__main__":
    main()
