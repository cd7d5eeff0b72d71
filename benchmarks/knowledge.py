"""True knowledge must not worsen the held-out prediction of a real rig: geared motors, encoders zeroed each time.

    python benchmarks/knowledge.py FOLDER        of the recordings: dfki_design_a ...

Each release of the DFKI double pendulum, design A, is held out once, with each part of the knowledge, with all of it
and with none. The measure is the error of the free run along the held-out release, because the share of the gap that
closes refers to a bare model that the knowledge changes as well.
"""

import json
from collections.abc import Callable
from pathlib import Path

from _bars import Bar, at_most, options, show
from _real import dfki_rig, geared, rezeroed

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv

KNOWN: dict[str, Callable[[Rig], Rig]] = {
    "nothing": lambda rig: rig,
    "rezeroed": rezeroed,
    "geared": geared,
    "both": lambda rig: geared(rezeroed(rig)),
}
WORSE = 1.0
"""Ratio of the error with all knowledge to that with less, at most."""


def main() -> None:
    """Diagnose, compare, print."""
    parser = options(__doc__)
    parser.add_argument("folder", type=Path, help="of the recordings: dfki_design_a ...")
    args = parser.parse_args()
    files = sorted((args.folder / "dfki_design_a").glob("*.csv"))
    rig = dfki_rig(json.loads(files[0].with_suffix(".json").read_text(encoding="utf-8")))
    bars: list[Bar] = []
    for unseen in files:
        errors = {}
        for name, knowing in KNOWN.items():
            runs = {file: import_csv(file, knowing(rig), ImportOptions(zero="hanging")) for file in files}
            fitted = [runs[file] for file in files if file != unseen]
            found = diagnose(fitted, knowing(rig), held_out=[runs[unseen]])
            errors[name] = found.gap.free_run_rad[runs[unseen].name]["after"]
            bars.append(Bar(f"{unseen.stem}: free run, rad, knowing {name}", "-", errors[name], None))
        least = min(errors[name] for name in KNOWN if name != "both")
        bars.append(at_most(f"{unseen.stem}: both over the best of less", errors["both"] / least, WORSE))
    show("Knowledge of a real rig", bars, args.json)


if __name__ == "__main__":
    main()
