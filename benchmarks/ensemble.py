"""Predictive bands of an ensemble of sampled models: how many readings of held-out recordings they cover.

    python benchmarks/ensemble.py [--plants 6] [--members 50] [--real ../shared/data/real] [--json]

Simulated plants with one effect each; three recordings of 5 s are diagnosed, three from other poses are held out. Real
rigs: every second piece of 10 s of a long free swing, and one of two releases of a geared rig, are held out.
"""

import json
from pathlib import Path

import numpy as np
from _bars import Bar, options, show
from _real import PIECE_S, PIECES, dfki_rig

from dpr_lab.exports.corrected import corrected_model
from dpr_lab.exports.ensemble.bands import PredictiveBand, predictive_band
from dpr_lab.exports.ensemble.sampled import posterior_of, sampled_models
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed

PLANTS = (
    {},
    {"coulomb_joint2": {"torque_Nm": 1.5e-3}},
    {"coulomb_joint1": {"torque_Nm": 2e-3}},
    {"air_drag_outer": {"coefficient_kg_per_m2": 8e-3}},
    {"rotor_inertia_joint2": {"inertia_kgm2": 3e-4}},
    {"spring_joint1": {"stiffness_Nm_per_rad": 0.02}},
)


def bands(fitted: list[Run], held_out: list[Run], rig: Rig, members: int, seed: int) -> list[PredictiveBand]:
    """Bands of a diagnosis' ensemble for recordings that were held out."""
    diagnosis = diagnose(fitted, rig)
    model = corrected_model(diagnosis, fitted, rig)
    ensemble = sampled_models(model, posterior_of(model, diagnosis), members, seed)
    sets = [f"{'+'.join(c.effects) or 'none'} {c.probability:.2f}" for c in diagnosis.posterior]
    print(f"# {diagnosis.verdict}: {'; '.join(sets)}", flush=True)
    made = [predictive_band(model, ensemble, run, rig, seed) for run in held_out]
    for band in made:
        within = f"{100 * band.covered:.1f} % of {band.readings}"
        print(
            f"#   {band.run}: {within}, until {band.horizon_s:.2f} s, {1e3 * band.width_rad:.3g} mrad wide", flush=True
        )
    return made


def simulated(number: int, members: int) -> list[PredictiveBand]:
    """Of one plant."""
    plant, rig = weighed(load_plant("paper", 30 + number), load_rig("paper"))
    plant = plant.model_copy(update={"effects": PLANTS[number % len(PLANTS)]})
    runs = record(plant, rig, duration=5.0)
    poses = {
        name: pose.model_copy(update={"theta1": pose.theta1 + 0.5, "theta2": pose.theta2 - 0.7})
        for name, pose in rig.poses.items()
    }
    unseen = record(plant, rig.model_copy(update={"poses": poses}), duration=5.0)
    return bands(list(runs), list(unseen), rig, members, number)


def real(folder: Path, members: int) -> dict[str, list[PredictiveBand]]:
    """Of both real rigs."""
    rig = load_rig("multiarm")
    cuts = [ImportOptions(zero="hanging", start_s=PIECE_S * k, duration_s=PIECE_S) for k in range(PIECES)]
    pieces = [import_csv(folder / "multiarm" / "dp_freeswing_1khz.csv", rig, cut) for cut in cuts]
    geared = folder / "dfki_design_a"
    dfki = dfki_rig(json.loads((geared / "release_060143.json").read_text(encoding="utf-8")))
    releases = [import_csv(file, dfki, ImportOptions(zero="hanging")) for file in sorted(geared.glob("*.csv"))]
    return {
        "multiarm": bands(pieces[0::2], pieces[1::2], rig, members, 0),
        "dfki design A": bands(releases[:1], releases[1:], dfki, members, 0),
    }


def pooled(name: str, some: list[PredictiveBand]) -> Bar:
    """Coverage of all readings."""
    hits = sum(band.covered * band.readings for band in some if band.readings)
    share = 100 * hits / max(sum(band.readings for band in some), 1)
    return Bar(f"{name}: 90 % bands cover, %", "86 .. 94", share, bool(86 <= share <= 94))


def main() -> None:
    """Measure and print."""
    parser = options(__doc__)
    parser.add_argument("--plants", type=int, default=6)
    parser.add_argument("--members", type=int, default=50)
    parser.add_argument("--real", type=Path, default=Path(__file__).parents[2] / "shared" / "data" / "real")
    chosen = parser.parse_args()
    made = [band for number in range(chosen.plants) for band in simulated(number, chosen.members)]
    found = [pooled("simulated rigs", made)] if made else []
    if chosen.real.is_dir():
        found += [pooled(name, some) for name, some in real(chosen.real, chosen.members).items()]
    show("predictive bands of ensembles", found, chosen.json)


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
