"""Page of the documentation with diagnoses of published recordings of real rigs.

Every recording of a rig is held out once and predicted from the other recordings of this rig.

    python benchmarks/real.py FOLDER                    print the page
    python benchmarks/real.py FOLDER --write            print the page and write it to docs/real-rigs.md
    python benchmarks/real.py FOLDER --only DFKI        print only the rigs whose title contains DFKI
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
from dpr_lab.effects import effect_params
from dpr_lab.fitting.estimate import Estimate, unknown_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.report.gap.sizes import sizes_cell
from dpr_lab.report.words import in_words, named
from dpr_lab.rig import PARAMETERS, Rig, load_rig, parse_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.workflows.rig_drive import MotorMeasures
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure

PAGE = Path(__file__).parents[1] / "docs" / "real-rigs.md"
HANGING = ImportOptions(zero="hanging", unit=None, time_unit=None)


@dataclass(frozen=True, slots=True)
class Published:
    """Model that the authors of the rig published."""

    Z: Mapping[str, float]
    """Nine parameters, SI units, by name."""
    effects: Mapping[str, Mapping[str, float]]
    """Further terms of the model: parameters of each effect of the library."""
    words: str


@dataclass(frozen=True, slots=True)
class RealRig:
    """A real rig and its recordings."""

    title: str
    known: str
    rig: Rig
    runs: list[Run]
    published: Published | None = None

    @property
    def folds(self) -> Iterator[tuple[list[Run], list[Run]]]:
        """Fitted and held-out runs of each diagnosis, with each run held out once.

        A single run is not held out; the diagnosis cuts it into parts.
        """
        if len(self.runs) == 1:
            yield self.runs, []
        else:
            for unseen in self.runs:
                yield [run for run in self.runs if run is not unseen], [unseen]


@dataclass(frozen=True, slots=True)
class Fold:
    """One diagnosis of a real rig."""

    held_out: str
    fitted: list[Run]
    unseen: list[Run]
    diagnosis: Diagnosis
    seconds: float
    """CPU time of the diagnosis, s."""

    @property
    def closed(self) -> float:
        """Gap reduction on the held-out data, as a share."""
        return self.diagnosis.gap.closed_held_out.estimate

    @property
    def of_reproducible(self) -> float | None:
        """Explained share of the reproducible gap in the fitted recordings; None if unknown."""
        budget = self.diagnosis.gap.budget
        return budget.of_reproducible if budget else None


def rigs(folder: Path) -> Iterator[RealRig]:
    """All rigs with a recording."""
    yield _multiarm(folder / "multiarm")
    yield _dfki(folder / "dfki_design_a")
    yield from _one_rod(folder)
    yield from _driven(folder / "dfki_driven")
    yield _closed_loop(folder / "dfki_leaderboard")
    yield from _rotary(folder / "furuta_odrive")


def _multiarm(folder: Path) -> RealRig:
    file, rig = folder / "dp_freeswing_1khz.csv", load_rig("multiarm")
    known = json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))["known_parameters"]
    Z = {"l1": known["a1_m"], "l2": known["a2_m"], "m1": known["m1_kg"], "m2": known["m2_kg"], "mb": 0.0}
    Z |= {"c1": known["k1_Nms"], "c2": known["k2_Nms"], "J1": known["J1_kgm2"], "J2": known["J2_kgm2"]}
    return RealRig(
        "MultiArm pendulum, 80 s at 1 kHz",
        "Kaheman et al. (2022), arXiv 2205.06231; data of dynamicslab/MultiArm-Pendulum, MIT. The rods have ball"
        " bearings and one encoder per joint. The cart is fixed, and the angles seem to be interpolated. The single"
        " recording is divided into parts, and every second part is held out.",
        rig,
        [import_csv(file, rig, HANGING)],
        Published(Z, {}, "viscous friction at both joints"),
    )


def _dfki(folder: Path) -> RealRig:
    files = sorted(folder.glob("*.csv"))
    sidecar = json.loads(files[0].with_suffix(".json").read_text(encoding="utf-8"))
    rig, model = geared(rezeroed(dfki_rig(sidecar))), sidecar["known_parameters"]["model_1_0"]
    Z = {"l1": model["r1"], "l2": model["r2"], "m1": model["m1"], "m2": model["m2"], "mb": 0.0}
    Z |= {"c1": model["b1"], "c2": model["b2"]}
    Z |= {f"J{i}": model[f"I{i}_pivot"] - model[f"m{i}"] * model[f"r{i}"] ** 2 for i in (1, 2)}
    rotor = {"inertia_kgm2": model["Ir_rotor"] * model["gear"] ** 2}
    effects = {f"coulomb_joint{i}": {"torque_Nm": model[f"coulomb{i}_Nm"]} for i in (1, 2)}
    effects |= {f"rotor_inertia_joint{i}": rotor for i in (1, 2)}
    return RealRig(
        "DFKI double pendulum, design A",
        "dfki-ric-underactuated-lab/double_pendulum, BSD-3-Clause. Each joint has a geared motor with"
        " zero torque. The encoders are zeroed before each of the two releases of 5 s at 200 Hz.",
        rig,
        [import_csv(file, rig, HANGING) for file in files],
        Published(Z, effects, "viscous and Coulomb friction and rotor inertia at both joints"),
    )


def _one_rod(folder: Path) -> Iterator[RealRig]:
    arm = _drafted("multiarm", 0.2, 0.15, 40_000)
    long, tail = (
        import_csv(folder / "multiarm" / f"sp_{name}.csv", arm, HANGING)
        for name in ("freeswing_1khz", "tail_to_stop_2khz")
    )
    source = "dynamicslab/MultiArm-Pendulum, MIT. One arm on a bearing; the cart is fixed"
    yield RealRig("MultiArm, one arm, 55 s at 1 kHz", f"{source}. The authors joined six pieces.", arm, [long])
    yield RealRig("MultiArm, one arm, the last 7 s until it stops", f"{source}. The sample rate is 2 kHz.", arm, [tail])
    cart, counts = _drafted("pendule_pi", 0.4, 0.1, 4096), replace(HANGING, unit="counts")
    packets = [import_csv(file, cart, counts) for file in sorted((folder / "pendule_pi").glob("*.csv"))]
    known = "francofusco/pendule_pi, BSD-3-Clause. One rod on a cart that is assumed to be fixed. The counts of"
    known += " an incremental encoder were recorded at 200 Hz, in packets of 5 s. The rig file states 4096 counts per"
    known += " turn. The hanging rod reads -3 counts in packets 0 to 4, and 3997 counts after a whole turn in packets 6"
    known += " to 9. The encoder therefore has 4000 counts per turn, and the rig file has a scale error of -2.34 %."
    yield RealRig("Pendule-Pi, one rod", known, cart, packets)
    rotary = _drafted("rotary", 0.124, 0.01225, 16384)
    swings = [import_csv(file, rotary, HANGING) for file in sorted((folder / "rotary_pendulum").glob("*.csv"))]
    known = (
        "jensen-benard/rotary-inverted-pendulum, MIT. One rod of a rotary pendulum was released by hand and recorded"
        " at 1 kHz without time stamps."
    )
    yield RealRig("Rotary pendulum, one rod", known, rotary, swings)


def _drafted(name: str, length: float, mass: float, counts: int) -> Rig:
    """Create a rig with one rod, of which only length, mass and encoder are known."""
    rod = Measure(mass)
    measures = RigMeasures(name, length, length, rod, rod, counts_per_rev=counts)
    return parse_rig(draft_rig(measures)).with_rods("inner")


def _driven(folder: Path) -> Iterator[RealRig]:
    for design in ("A.0", "C.0", "C.1"):
        files = sorted(folder.glob(f"{design}_*.csv"))
        sidecar = json.loads(files[0].with_suffix(".json").read_text(encoding="utf-8"))
        lengths = sidecar["lengths"]["l1_m"], sidecar["lengths"]["l2_m"]
        yield _with_drives(
            f"DFKI double pendulum, design {design}, driven",
            "dfki-ric-underactuated-lab/double_pendulum, BSD-3-Clause. Geared motors drive both joints and measure"
            " their torques. The encoders are zeroed before each recording.",
            lengths,
            sidecar["authors_model"],
            files,
            replace(HANGING, angles="relative", torque="measured"),
        )


def _closed_loop(folder: Path) -> RealRig:
    files = sorted(folder.glob("*.csv"))
    sidecar = json.loads(files[0].with_suffix(".json").read_text(encoding="utf-8"))
    return _with_drives(
        "DFKI double pendulum, design C.1, closed loop",
        "dfki-ric-underactuated-lab/double_pendulum, BSD-3-Clause. A controller swings the pendulum up and balances"
        " it, as an acrobot and as a pendubot. The drives measure their torques at 400 to 500 Hz.",
        sidecar["lengths_m"],
        sidecar["authors_model"],
        files,
        replace(HANGING, torque="measured"),
    )


def _with_drives(
    title: str,
    known: str,
    lengths: tuple[float, float],
    model: Mapping[str, float],
    files: list[Path],
    options: ImportOptions,
) -> RealRig:
    """Create a rig with geared drives, of which only lengths and masses are known."""
    masses = Measure(model["m1"]), Measure(model["m2"])
    name = title.replace("double pendulum, design", "").lower().split(",")[0]
    rig = geared(rezeroed(parse_rig(draft_rig(RigMeasures(name, *lengths, *masses)))))
    return RealRig(title, known, rig, [import_csv(file, rig, options) for file in files])


def _rotary(folder: Path) -> Iterator[RealRig]:
    """Arm, rod and motor of a Furuta pendulum.

    The two recordings have different inputs. Therefore each is a separate rig and is cut into parts.
    """
    files = {name: folder / f"{name}.csv" for name in ("free_rod_2023", "sine_4V")}
    known = json.loads(files["sine_4V"].with_suffix(".json").read_text(encoding="utf-8"))["parameters"]
    motor = MotorMeasures("voltage", kt=Measure(known["motor_Kt_Nm_A"]), R=Measure(known["motor_R_ohm"]))
    measures = RigMeasures(
        "odrive", known["rod_length_m"], None, Measure(known["rod_mass_kg"]), None, L0=known["arm_length_m"]
    )
    rig = parse_rig(draft_rig(replace(measures, counts_per_rev=8192, mounted="inner", arm="driven", motor=motor)))
    source = (
        "macstepien/furuta_pendulum, GPL-3.0. One rod on an arm with a direct-drive motor; 500 Hz, host time stamps"
    )
    yield RealRig(
        "Furuta pendulum, free rod",
        f"{source}. Cogging of the motor holds the arm.",
        rig,
        [import_csv(files["free_rod_2023"], rig, replace(HANGING, arm="clamped"))],
    )
    yield RealRig(
        "Furuta pendulum, arm driven by a sine",
        f"{source}. The input is a sine of 4 V and 1 Hz for 3 s; rods and arm are counted in opposite directions.",
        rig,
        [import_csv(files["sine_4V"], rig, replace(HANGING, scale={"theta1": -1.0}))],
    )


def diagnosed(real: RealRig) -> Iterator[Fold]:
    """Diagnose the rig once for each held-out recording."""
    for fitted, unseen in real.folds:
        start_s = time.process_time()
        diagnosis = diagnose(fitted, real.rig, held_out=unseen)
        of_single = "each quarter" if diagnosis.basis == "one release" else "every second part"
        yield Fold(unseen[0].name if unseen else of_single, fitted, unseen, diagnosis, time.process_time() - start_s)


def section(real: RealRig, folds: list[Fold]) -> str:
    """Write the section on one rig: diagnoses, and comparison with the published model on the same held-out runs."""
    lines = [f"## {real.title}", "", real.known, ""]
    for fold in folds:
        low, high = fold.diagnosis.gap.closed_held_out.interval90
        verdict = in_words(" ".join([fold.diagnosis.sentence, *fold.diagnosis.notes]))
        compared = _compared(real, fold, real.published) if real.published else ([], [])
        lines += [
            *([f"### Held out: {fold.held_out}", ""] if len(folds) > 1 else []),
            f"Verdict: **{fold.diagnosis.verdict.replace('_', ' ')}**. {verdict}",
            "",
            f"The corrected model explains {_percent(fold.diagnosis.gap.explained_share)} of the excess chi-square of"
            f" the fitted recordings. On held-out data the gap closes by {_percent(fold.closed)} (90 % interval"
            f" {_percent(low)} to {_percent(high)}). The diagnosis took {fold.seconds:.0f} s on one core.",
            "",
            *compared[0],
            *_effects(fold.diagnosis),
            *compared[1],
        ]
    return "\n".join(lines)


def summary(diagnoses: list[tuple[RealRig, list[Fold]]]) -> str:
    """Write a table with a row for every held-out recording, then the median and the worst of all."""
    rows = [
        [
            real.title,
            fold.held_out,
            fold.diagnosis.verdict.replace("_", " "),
            _percent(fold.closed),
            "" if fold.of_reproducible is None else _percent(fold.of_reproducible),
            f"{fold.seconds:.0f}",
        ]
        for real, folds in diagnoses
        for fold in folds
    ]
    all_folds = [fold for _, folds in diagnoses for fold in folds]
    reproducible = [fold.of_reproducible for fold in all_folds if fold.of_reproducible is not None]
    closed, seconds = [fold.closed for fold in all_folds], [fold.seconds for fold in all_folds]
    for word, share, duration in (("median", np.median, np.median), ("worst", np.min, np.max)):
        explained = _percent(float(share(reproducible))) if reproducible else ""
        rows.append([f"**{word}**", "", "", _percent(float(share(closed))), explained, f"{duration(seconds):.0f}"])
    head = ["rig", "held-out recording", "verdict", "gap reduction on held-out data"]
    head += ["explained share of the reproducible gap, fitted recordings", "CPU time, s"]
    return "\n".join(["## Summary", "", *_table(head, rows), ""])


def _compared(real: RealRig, fold: Fold, published: Published) -> tuple[list[str], list[str]]:
    """Write tables of ratios and of free runs on held-out recordings, with the published model in one column."""
    _, unseen, _ = in_pieces(fold.fitted, fold.unseen)
    base = base_parameters([published.Z[name] for name in PARAMETERS], real.rig.L1, real.rig.g)
    diagnosis = fold.diagnosis
    estimate = Estimate.of(unknown_ratios(base), effect_params(published.effects), np.zeros((0, 4)))
    of_published = free_runs(Recordings(tuple(record(run, real.rig) for run in unseen), real.rig), estimate).errors_rad
    names = [run.name for run in unseen if run.name in diagnosis.gap.free_run_rad]
    errors = np.array([[of_published[name], *diagnosis.gap.free_run_rad[name].values()] for name in names])
    rows = [[name, *_four(row)] for name, row in zip(names, errors, strict=True)]
    rows.append(["**median**", *_four(np.median(errors, axis=0))])
    head = ["recording", f"published ({published.words})", "bare model", "corrected model"]
    ratio_table = _table(["ratio", "estimate", "90 % interval", "published"], _ratios(diagnosis, ratios(base)))
    caption = "Rms error of the free run on held-out recordings in rad; initial state fitted to the first 0.3 s:"
    return [*ratio_table, ""], [caption, "", *_table(head, rows), ""]


def _four(values: NDArray[np.float64]) -> list[str]:
    return [f"{value:.4f}" for value in values.tolist()]


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]


def _ratios(diagnosis: Diagnosis, published: Any) -> list[list[str]]:
    return [
        [name, f"{ratio.value:.5g}", f"[{ratio.interval90[0]:.5g}, {ratio.interval90[1]:.5g}]", f"{value:.5g}"]
        for name, value in zip(RATIOS, published.tolist(), strict=True)
        for ratio in (diagnosis.all_ratios[name],)
    ]


def _effects(diagnosis: Diagnosis) -> list[str]:
    """Table of the named effects; empty if there are none."""
    rows = [
        [named(effect.name), _percent(effect.probability), _percent(effect.share), sizes_cell(diagnosis, effect)]
        for effect in diagnosis.effects
    ]
    return [*_table(["effect", "probability", "unique contribution", "size (90 % interval)"], rows), ""] if rows else []


HEAD = """# Diagnoses of real rigs

This page is for readers who judge dpr-lab by real data. It lists diagnoses of recordings that other laboratories
published. `benchmarks/real.py` computes all figures. If a rig has several recordings, each one is held out once
and predicted from the others. A single recording is divided: every second part is held out, or, if the recording is
short, each quarter is predicted from the other quarters.

The reproducible gap is the mean squared gap that free-form corrections of torques and readings can remove
([Reading the report](reading-the-report.md)). It is computed on the fitted recordings. An explained share of 100 % does
not mean that nothing remains: the rest differs from recording to recording.

"Published" is the model of the authors of a rig. It is simulated with their parameters on the same held-out recordings
and from the same initial states as the bare and the corrected model. A published ratio can lie outside the 90 %
interval of the estimate, because the interval is valid only for the fitted model. It does not include the error that
arises if the friction of the rig is not in the library or cannot be distinguished from other parameters.
"""

OPEN = """## Limits of these diagnoses

- For the rigs with one rod, only a length and a mass are known. Their rig files were drafted with `dpr-lab rig new`.
  A single rod determines two ratios.
- Most driven recordings are only partly explained, because the library contains only friction, rotor inertia, torque
  constant, torque offset and delay of a geared drive ([Driven rigs](benchmarks/parameters.md#driven-rigs)).
"""


def main() -> None:
    """Print the page; with `--write` also save it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder with the recordings: multiarm, dfki_design_a ...")
    parser.add_argument("--write", action="store_true", help="also write the page of the documentation")
    parser.add_argument("--only", default="", help="print only the rigs whose title contains this text")
    args = parser.parse_args()
    diagnoses, sections = list[tuple[RealRig, list[Fold]]](), list[str]()
    for real in rigs(args.folder):
        if args.only in real.title:
            diagnoses.append((real, list(diagnosed(real))))
            sections.append(section(*diagnoses[-1]))
            print(sections[-1], flush=True)
    print(summary(diagnoses))
    if args.write and not args.only:
        PAGE.write_text("\n".join([HEAD, summary(diagnoses), *sections, OPEN]), encoding="utf-8")


if __name__ == "__main__":
    main()
