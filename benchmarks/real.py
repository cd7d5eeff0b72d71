"""Page of the documentation with diagnoses of published recordings of real rigs.

Every recording of a rig is held out once and predicted from the other recordings of this rig.

    python benchmarks/real.py FOLDER                    print the page
    python benchmarks/real.py FOLDER --write            print the page and write it to docs/real-rigs.md
    python benchmarks/real.py FOLDER --only DFKI        print only the rigs whose title contains DFKI
"""

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from _real import Published, RealRig, dfki_rig, geared, rezeroed
from _real_page import HEAD, OPEN, Fold, diagnosed, section, summary

from dpr_lab.rig import Rig, load_rig, parse_rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.workflows.rig_drive import MotorMeasures
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure

PAGE = Path(__file__).parents[1] / "docs" / "real-rigs.md"
HANGING = ImportOptions(zero="hanging", unit=None, time_unit=None)


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
        " bearings and one encoder per joint. The cart is fixed. The angles are probably interpolated.",
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
