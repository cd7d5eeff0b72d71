"""Plants, rigs and runs whose results are stored in this folder, and the format of these results.

Run as a program it freezes the answers of the code at hand: `python tests/golden/cases.py diagnose identify real`.
"""

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from sim_device.plant.config import PlantConfig, load_plant
from sim_device.trials.draw import draw_plant
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed
from sim_device.trials.request import parse_request

FOLDER = Path(__file__).parent
REAL = FOLDER.parents[2] / "shared" / "data" / "real"

DIAGNOSED: Mapping[int, str] = {
    910_001: "clean",
    910_002: "clean",
    910_003: "single:clear:coulomb_joint1",
    910_004: "single:clear:stribeck_joint2",
    910_005: "single:clear:friction_curve_joint1",
    910_006: "single:clear:load_friction_joint2",
    910_007: "single:clear:hysteresis_joint1",
    910_008: "single:clear:friction_drift_joint2",
    910_009: "single:clear:viscous_ground_link2",
    910_010: "single:clear:air_drag_outer",
    910_011: "single:clear:spring_joint2",
    910_012: "single:clear:detent_joint1",
    910_013: "single:clear:rotor_inertia_joint2",
    910_014: "single:clear:backlash_joint2",
    910_015: "single:clear:base_tilt",
    910_016: "single:clear:com_offset_link2",
    910_017: "single:clear:arm_compliance",
    910_018: "single:clear:base_vibration",
    910_019: "single:clear:encoder_offset_joint2",
    910_020: "single:clear:encoder_scale_joint1",
    910_021: "single:clear:encoder_eccentricity_joint2",
    910_022: "single:clear:latency_joint2",
    910_023: "single:clear:clock_rate",
    910_024: "single:clear:missed_counts",
    910_025: "single:subtle",
    910_026: "pair:clear:arm_compliance,coulomb_joint2",
    910_027: "pair:clear",
    910_028: "triple:clear",
    910_029: "dirty:clear",
    910_030: "outside:clear:tuning",
}
"""Draw specification of each seed."""

IDENTIFIED: Mapping[int, str] = {
    **{920_000 + i: "clean" for i in range(12)},
    920_012: "single:clear:coulomb_joint1",
    920_013: "single:clear:air_drag_outer",
    920_014: "single:clear:spring_joint2",
    920_015: "single:subtle",
    920_016: "pair:clear",
    920_017: "dirty:clear",
    920_018: "dirty:clear",
    920_019: "outside:clear:tuning",
}

PIECES, PIECE_S = 8, 10.0
"""The long swing of a real rig: every second piece is held out."""


def drawn(seed: int, wanted: str) -> tuple[PlantConfig, Rig]:
    """Draw a plant, and the rig file for dpr-lab: measured masses, and bounds of the other parameters."""
    base, rig = weighed(load_plant("paper", seed), load_rig("paper"))
    return draw_plant(parse_request(wanted), base, rig), rig


def recorded(plant: dict[str, Any]) -> tuple[list[Run], Rig]:
    """Record a stored plant, and return the recordings and the rig file for dpr-lab."""
    hidden = PlantConfig.model_validate(plant)
    _, rig = weighed(load_plant("paper", hidden.seed), load_rig("paper"))
    return record(hidden, rig), rig


def diagnosed(runs: list[Run], rig: Rig, held_out: list[Run]) -> dict[str, Any]:
    """Results of a diagnosis that are stored."""
    from dpr_lab.gap.diagnose import diagnose

    result = diagnose(runs, rig, held_out=held_out).to_json()
    kept = ("verdict", "probabilities", "ratios", "chi2_per_dof", "segments", "model_effects")
    gap = {key: result["gap"][key] for key in ("explained_share", "closed_held_out", "free_run_rad")}
    return {key: result[key] for key in kept} | {"effects": result["effects"], "gap": gap}


def identified(runs: list[Run], rig: Rig) -> dict[str, Any]:
    """Results of an identification that are stored."""
    from dpr_lab.identification.identify import identify

    model = identify(runs, rig, seed=0).model_dump()
    return {key: model[key] for key in ("ratios", "covariance", "parameters", "base", "fit")}


def real_rigs() -> Iterator[tuple[str, list[Run], Rig, list[Run]]]:
    """Name, runs, rig and held-out runs of recordings of real rigs, which are not in the repository."""
    from dpr_lab.storage.csv_import import ImportOptions, import_csv

    rig, file = load_rig("multiarm"), REAL / "multiarm" / "dp_freeswing_1khz.csv"
    cuts = [ImportOptions(zero="hanging", start_s=PIECE_S * k, duration_s=PIECE_S) for k in range(PIECES)]
    runs = [replace(import_csv(file, rig, cut), name=f"piece {k}") for k, cut in enumerate(cuts)]
    yield "multiarm", runs[0::2], rig, runs[1::2]
    rig = load_rig(FOLDER / "dfki_design_a.toml")
    files = sorted((REAL / "dfki_design_a").glob("*.csv"))
    first, second = (import_csv(file, rig, ImportOptions(zero="hanging")) for file in files)
    yield "dfki, first", [first], rig, [second]
    yield "dfki, second", [second], rig, [first]


def _diagnosis(case: tuple[int, str]) -> dict[str, Any]:
    plant, rig = drawn(*case)
    return {"drawn": case[1], "plant": plant.model_dump(mode="json"), **diagnosed(record(plant, rig), rig, [])}


def _identification(case: tuple[int, str]) -> dict[str, Any]:
    plant, rig = drawn(*case)
    return {"drawn": case[1], "plant": plant.model_dump(mode="json"), **identified(record(plant, rig), rig)}


def _real(number: int) -> dict[str, Any]:
    name, runs, rig, held_out = list(real_rigs())[number]
    return {"name": name, **diagnosed(runs, rig, held_out)}


def _written(name: str, work: Callable[[Any], dict[str, Any]], cases: list[Any], keys: list[str]) -> None:
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        jobs = [pool.submit(work, case) for case in cases]
        answers = {}
        for key, job in zip(keys, jobs, strict=True):
            answers[key] = job.result()
            print(name, key, file=sys.stderr, flush=True)
    (FOLDER / f"{name}.json").write_text(json.dumps(answers, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Store the results of the cases that are named on the command line."""
    for name in sys.argv[1:]:
        if name == "diagnose":
            _written(name, _diagnosis, list(DIAGNOSED.items()), [str(seed) for seed in DIAGNOSED])
        elif name == "identify":
            _written(name, _identification, list(IDENTIFIED.items()), [str(seed) for seed in IDENTIFIED])
        else:
            _written(name, _real, [0, 1, 2], ["multiarm", "dfki, first", "dfki, second"])


if __name__ == "__main__":
    main()
