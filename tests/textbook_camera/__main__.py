"""Write captures of textbook cameras: one case or all cases of a sealed round, or a camera with stated deviations.

::

    python -m tests.textbook_camera FOLDER --round 3                 # all 64 cases: case_01.h5, case_01.truth.json, ...
    python -m tests.textbook_camera FILE.h5 --round 3 --case 12
    python -m tests.textbook_camera FILE.h5 --hidden '{"gain": {"factor": 1.05}}' --world laboratory --seed 7
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from tests.textbook_camera.camera import Datasheet
from tests.textbook_camera.recording import save
from tests.textbook_camera.suite import Case, cases, deviation, record, seed_of
from tests.textbook_camera.vocabulary import OUTSIDE, WORDS


def main() -> None:
    """Read the command line, record, and print where the files are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="file to write, or the folder for all cases of a round")
    parser.add_argument("--round", type=int, help="number of the sealed round")
    parser.add_argument("--case", type=int, help="number of a case of the round, from 1; without it all cases")
    parser.add_argument(
        "--hidden", type=json.loads, help="deviations and their parameters as JSON, in place of a round"
    )
    parser.add_argument("--world", choices=("clean", "laboratory"), default="clean", help="world of --hidden")
    parser.add_argument("--seed", type=int, default=0, help="seed of --hidden")
    parser.add_argument("--size", type=int, default=64, help="side of the field in pixels, a multiple of 16")
    arguments = parser.parse_args()
    if (arguments.round is None) == (arguments.hidden is None):
        parser.error("give either --round NUMBER or --hidden JSON")
    if arguments.hidden is not None:
        if unknown := set(arguments.hidden) - set(WORDS) - set(OUTSIDE):
            parser.error(
                f"no deviation is called {', '.join(sorted(unknown))}; there are {', '.join([*WORDS, *OUTSIDE])}"
            )
        datasheet = Datasheet(gray=any(deviation(name).gray for name in arguments.hidden))
        chosen = [(arguments.out, Case(arguments.world, arguments.hidden, datasheet), arguments.seed)]
    else:
        drawn = cases(arguments.round)
        if arguments.case is not None and not 1 <= arguments.case <= len(drawn):
            parser.error(f"--case is {arguments.case}; a round has the cases 1 to {len(drawn)}")
        wanted = [case for case in drawn if arguments.case in (None, case.number)]
        files = [arguments.out / f"case_{case.number:02d}.h5" if len(wanted) > 1 else arguments.out for case in wanted]
        chosen = [(file, case, seed_of(arguments.round, case.number)) for file, case in zip(files, wanted, strict=True)]
    for file, case, seed in chosen:
        save(file, *record(case, seed, arguments.size))
        print(file)


if __name__ == "__main__":
    main()
