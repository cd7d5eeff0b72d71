"""Diagnoses of recordings of real rigs that others made and published, as a page of the documentation.

Every recording of a rig is held out once, and predicted from the others of that rig.

    python benchmarks/real.py FOLDER                    print it
    python benchmarks/real.py FOLDER --write            and write docs/real-rigs.md
    python benchmarks/real.py FOLDER --only DFKI        the rigs of such a title alone, without the summary
"""

import argparse
import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from _real import dfki_rig, geared, rezeroed
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS, base_parameters, ratios
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.fitting.estimate import Estimate, unknown_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.rig import PARAMETERS, Rig, load_rig, parse_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.workflows.rig_file import Measure, RigMeasures, draft_rig

PAGE = Path(__file__).parents[1] / "docs" / "real-rigs.md"
HANGING = ImportOptions(zero="hanging", unit=None, time_unit=None)


@dataclass(frozen=True, slots=True)
class Published:
    """The model that the rig's own authors printed."""

    Z: Mapping[str, float]
    """The nine parameters, SI."""
    effects: Mapping[str, Mapping[str, float]]
    """What else it holds, by the effects of the library."""
    words: str


@dataclass(frozen=True, slots=True)
class RealRig:
    """One rig and its recordings."""

    title: str
    known: str
    rig: Rig
    runs: list[Run]
    published: Published | None = None

    @property
    def folds(self) -> Iterator[tuple[list[Run], list[Run]]]:
        """Fitted and held-out runs, each run held out once; a single run is cut into parts by the diagnosis."""
        if len(self.runs) == 1:
            yield self.runs, []
        else:
            for unseen in self.runs:
                yield [run for run in self.runs if run is not unseen], [unseen]


@dataclass(frozen=True, slots=True)
class Fold:
    """One diagnosis."""

    held_out: str
    fitted: list[Run]
    unseen: list[Run]
    diagnosis: Diagnosis
    seconds: float
    """CPU time."""

    @property
    def closed(self) -> float:
        """Share of the gap that closes on the held-out data."""
        return self.diagnosis.gap.closed_held_out.estimate

    @property
    def of_reproducible(self) -> float | None:
        """Share of what is reproducible in the fitted recordings that is explained; None where that is not known."""
        budget = self.diagnosis.gap.budget
        return budget.of_reproducible if budget else None


def rigs(folder: Path) -> Iterator[RealRig]:
    """Every rig of which there is a recording."""
    yield _multiarm(folder / "multiarm")
    yield _dfki(folder / "dfki_design_a")
    yield from _one_rod(folder)
    yield from _driven(folder / "dfki_driven")


def _multiarm(folder: Path) -> RealRig:
    file, rig = folder / "dp_freeswing_1khz.csv", load_rig("multiarm")
    known = json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))["known_parameters"]
    Z = {"l1": known["a1_m"], "l2": known["a2_m"], "m1": known["m1_kg"], "m2": known["m2_kg"], "mb": 0.0}
    Z |= {"c1": known["k1_Nms"], "c2": known["k2_Nms"], "J1": known["J1_kgm2"], "J2": known["J2_kgm2"]}
    return RealRig(
        "MultiArm pendulum, 80 s at 1 kHz",
        "Kaheman et al. (2022), arXiv 2205.06231; data of dynamicslab/MultiArm-Pendulum, MIT. Rods on ball bearings,"
        " cart fixed, one encoder per joint; the angles seem to be interpolated. The single recording is cut"
        " into parts, of which every second one is held out.",
        rig,
        [import_csv(file, rig, HANGING)],
        Published(Z, {}, "viscous friction at both joints"),
    )


def _dfki(folder: Path) -> RealRig:
    files = sorted(folder.glob("*.csv"))
    told = json.loads(files[0].with_suffix(".json").read_text(encoding="utf-8"))
    rig, model = geared(rezeroed(dfki_rig(told))), told["known_parameters"]["model_1_0"]
    Z = {"l1": model["r1"], "l2": model["r2"], "m1": model["m1"], "m2": model["m2"], "mb": 0.0}
    Z |= {"c1": model["b1"], "c2": model["b2"]}
    Z |= {f"J{i}": model[f"I{i}_pivot"] - model[f"m{i}"] * model[f"r{i}"] ** 2 for i in (1, 2)}
    rotor = {"inertia_kgm2": model["Ir_rotor"] * model["gear"] ** 2}
    effects = {f"coulomb_joint{i}": {"torque_Nm": model[f"coulomb{i}_Nm"]} for i in (1, 2)}
    effects |= {f"rotor_inertia_joint{i}": rotor for i in (1, 2)}
    return RealRig(
        "DFKI double pendulum, design A",
        "dfki-ric-underactuated-lab/double_pendulum, BSD-3-Clause. Each joint has a geared motor with"
        " zero"
        " torque; encoders zeroed before each recording; two releases of 5 s at 200 Hz.",
        rig,
        [import_csv(file, rig, HANGING) for file in files],
        Published(Z, effects, "viscous and dry friction and rotor inertia at both joints"),
    )


def _one_rod(folder: Path) -> Iterator[RealRig]:
    arm = _drafted("multiarm", 0.2, 0.15, 40_000)
    long, tail = (
        import_csv(folder / "multiarm" / f"sp_{name}.csv", arm, HANGING)
        for name in ("freeswing_1khz", "tail_to_stop_2khz")
    )
    made = "dynamicslab/MultiArm-Pendulum, MIT. One arm on a bearing, the cart fixed"
    yield RealRig("MultiArm, one arm, 55 s at 1 kHz", f"{made}; six pieces joined by its authors.", arm, [long])
    yield RealRig("MultiArm, one arm, the last 7 s until it stops", f"{made}; 2 kHz.", arm, [tail])
    cart, counts = _drafted("pendule_pi", 0.4, 0.1, 4096), replace(HANGING, unit="counts")
    packets = [import_csv(file, cart, counts) for file in sorted((folder / "pendule_pi").glob("*.csv"))]
    known = "francofusco/pendule_pi, BSD-3-Clause. One rod on a cart that is assumed fixed; counts of an"
    known += " incremental encoder at 200 Hz, packets of 5 s."
    yield RealRig("Pendule-Pi, one rod", known, cart, packets)
    rotary = _drafted("rotary", 0.124, 0.01225, 16384)
    swings = [import_csv(file, rotary, HANGING) for file in sorted((folder / "rotary_pendulum").glob("*.csv"))]
    known = (
        "jensen-benard/rotary-inverted-pendulum, MIT. One rod of a rotary pendulum, released by hand, 1 kHz; no time"
    )
    known += " stamps in the source."
    yield RealRig("Rotary pendulum, one rod", known, rotary, swings)


def _drafted(name: str, length: float, mass: float, counts: int) -> Rig:
    """A rig of one rod, of which only length, mass and encoder are known."""
    rod = Measure(mass)
    measures = RigMeasures(name, length, length, rod, rod, counts_per_rev=counts)
    return parse_rig(draft_rig(measures)).with_rods("inner")


def _driven(folder: Path) -> Iterator[RealRig]:
    for design in ("A.0", "C.0", "C.1"):
        files = sorted(folder.glob(f"{design}_*.csv"))
        sidecar = json.loads(files[0].with_suffix(".json").read_text(encoding="utf-8"))
        model, lengths = sidecar["authors_model"], sidecar["lengths"]
        inner, outer = Measure(model["m1"]), Measure(model["m2"])
        drafted = draft_rig(RigMeasures(f"dfki {design}", lengths["l1_m"], lengths["l2_m"], inner, outer))
        rig = geared(rezeroed(parse_rig(drafted)))
        options = replace(HANGING, angles="relative", torque="measured")
        yield RealRig(
            f"DFKI double pendulum, design {design}, driven",
            "dfki-ric-underactuated-lab/double_pendulum, BSD-3-Clause. Both joints driven by geared motors; torques as"
            " the drives measure them; encoders zeroed before each recording.",
            rig,
            [import_csv(file, rig, options) for file in files],
        )


def diagnosed(real: RealRig) -> Iterator[Fold]:
    """A diagnosis for each recording held out."""
    for fitted, unseen in real.folds:
        began = time.process_time()
        diagnosis = diagnose(fitted, real.rig, held_out=unseen)
        name = unseen[0].name if unseen else "every second part"
        yield Fold(name, fitted, unseen, diagnosis, time.process_time() - began)


def section(real: RealRig, folds: list[Fold]) -> str:
    """What was found on one rig, next to the published model on the same held-out recordings."""
    lines = [f"## {real.title}", "", real.known, ""]
    for fold in folds:
        low, high = fold.diagnosis.gap.closed_held_out.interval90
        compared = _compared(real, fold, real.published) if real.published else ([], [])
        lines += [
            *([f"### Held out: {fold.held_out}", ""] if len(folds) > 1 else []),
            f"Verdict: **{fold.diagnosis.verdict.replace('_', ' ')}**. {fold.diagnosis.sentence}",
            "",
            f"Explained excess chi-square of the fitted recordings: {_percent(fold.diagnosis.gap.explained_share)}. Gap"
            f" reduction on held-out data: {_percent(fold.closed)} (90 % interval {_percent(low)} to {_percent(high)})."
            f" Time: {fold.seconds:.0f} s on one core.",
            "",
            *compared[0],
            *_table(["effect", "probability", "share", "size"], _effects(fold.diagnosis)),
            "",
            *compared[1],
        ]
    return "\n".join(lines)


def summary(found: list[tuple[RealRig, list[Fold]]]) -> str:
    """Every held-out recording in one row, and the median and the worst of all."""
    rows = [
        [
            real.title,
            fold.held_out,
            fold.diagnosis.verdict.replace("_", " "),
            _percent(fold.closed),
            "" if fold.of_reproducible is None else _percent(fold.of_reproducible),
            f"{fold.seconds:.0f}",
        ]
        for real, folds in found
        for fold in folds
    ]
    every = [fold for _, folds in found for fold in folds]
    known = [fold.of_reproducible for fold in every if fold.of_reproducible is not None]
    closed, seconds = [fold.closed for fold in every], [fold.seconds for fold in every]
    for word, of, slow in (("median", np.median, np.median), ("worst", np.min, np.max)):
        of_known = _percent(float(of(known))) if known else ""
        rows.append([f"**{word}**", "", "", _percent(float(of(closed))), of_known, f"{slow(seconds):.0f}"])
    head = ["rig", "held out", "verdict", "gap closed on held-out data", "explained of what is reproducible", "CPU, s"]
    return "\n".join(["## Summary", "", *_table(head, rows), ""])


def _compared(real: RealRig, fold: Fold, published: Published) -> tuple[list[str], list[str]]:
    """Ratios, and free runs on held-out recordings, next to those of the published model."""
    _, unseen, _ = in_pieces(fold.fitted, fold.unseen)
    base, found = base_parameters([published.Z[name] for name in PARAMETERS], real.rig.L1, real.rig.g), fold.diagnosis
    at = Estimate.of(unknown_ratios(base), effect_params(published.effects), np.zeros((0, 4)))
    theirs = free_runs(Recordings(tuple(record(run, real.rig) for run in unseen), real.rig), at).errors_rad
    tried = [run.name for run in unseen if run.name in found.gap.free_run_rad]
    errors = np.array([[theirs[name], *found.gap.free_run_rad[name].values()] for name in tried])
    rows = [[name, *_four(row)] for name, row in zip(tried, errors, strict=True)]
    rows.append(["**median**", *_four(np.median(errors, axis=0))])
    head = ["recording", f"published ({published.words})", "bare model", "corrected model"]
    ratio_table = _table(["ratio", "estimate", "90 % interval", "published"], _ratios(found, ratios(base)))
    caption = (
        "Rms error of the free run on held-out recordings, rad; the initial state is fitted to the first readings:"
    )
    return [*ratio_table, ""], [caption, "", *_table(head, rows), ""]


def _four(values: NDArray[np.float64]) -> list[str]:
    return [f"{value:.4f}" for value in values.tolist()]


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]


def _ratios(found: Diagnosis, published: Any) -> list[list[str]]:
    return [
        [name, f"{v.value:.5g}", f"[{v.interval90[0]:.5g}, {v.interval90[1]:.5g}]", f"{theirs:.5g}"]
        for name, theirs in zip(RATIOS, published.tolist(), strict=True)
        for v in (found.ratios[name],)
    ]


def _effects(found: Diagnosis) -> list[list[str]]:
    return [
        [
            f"{EFFECTS[effect.name].words} (`{effect.name}`)",
            _percent(effect.probability),
            _percent(effect.share),
            ", ".join(f"{name} {v.value:.3g}" for name, v in effect.parameters.items()),
        ]
        for effect in found.effects
    ]


HEAD = """# Real rigs

Recordings that others made and published. Every recording of a rig is held out once and predicted from the others of
that rig. The page is written by `benchmarks/real.py`; no figure is made by hand. "Published" is the model that the
authors of a rig printed, simulated here from their parameters on the same held-out recordings and from the same start
as the others. Ratios under friction that the library lacks, or that a record cannot tell from the rods' own, may differ
from the published ones by more than their intervals, which hold for the model that is fitted.
"""

OPEN = """## Open questions

Rigs of which only a length and a mass are known are drafted as `dpr-lab rig new` drafts them; a single rod shows two
ratios. What geared drives do beyond friction, rotor, torque constant, offset and delay leaves most driven records
explained in part; their authors' models are compared in [benchmarks.md](benchmarks.md).
"""


def main() -> None:
    """Print the page, or write it too."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the recordings: multiarm, dfki_design_a ...")
    parser.add_argument("--write", action="store_true", help="write the page of the documentation too")
    parser.add_argument("--only", default="", help="print the rigs of such a title alone")
    args = parser.parse_args()
    found, sections = list[tuple[RealRig, list[Fold]]](), list[str]()
    for real in rigs(args.folder):
        if args.only in real.title:
            found.append((real, list(diagnosed(real))))
            sections.append(section(*found[-1]))
            print(sections[-1], flush=True)
    print(summary(found))
    if args.write and not args.only:
        PAGE.write_text("\n".join([HEAD, summary(found), *sections, OPEN]), encoding="utf-8")


if __name__ == "__main__":
    main()
