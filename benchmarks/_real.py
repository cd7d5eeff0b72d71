"""Real rigs with their recordings; diagnoses of two of them, if the user has these recordings."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from _bars import Bar, at_least, at_most

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.rig import PARAMETERS, Rig, load_rig
from dpr_lab.rig_tables import Encoders, Joints, Parameter, RigGeometry
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv

PIECES, PIECE_S = 8, 10.0
CLAIMED = 0.5
FIXED = 5.0  # factor by which an unmeasured value may differ from its nominal value
DRY = ("coulomb", "stribeck", "friction_curve", "hysteresis")


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


def real_bars(folder: Path) -> list[Bar]:
    """Results for the two rigs whose recordings are in `folder`."""
    return [*multiarm_bars(folder / "multiarm"), *dfki_bars(folder / "dfki_design_a")]


def multiarm_bars(folder: Path) -> list[Bar]:
    """Results for a long swing whose publication states only viscous friction; every second piece is held out."""
    rig = load_rig("multiarm")
    cuts = [ImportOptions(zero="hanging", start_s=PIECE_S * k, duration_s=PIECE_S) for k in range(PIECES)]
    runs = [
        replace(import_csv(folder / "dp_freeswing_1khz.csv", rig, cut), name=f"piece {k}") for k, cut in enumerate(cuts)
    ]
    diagnosis = diagnose(runs[0::2], rig, held_out=runs[1::2])
    errors = [diagnosis.gap.free_run_rad[run.name] for run in runs[1::2]]
    before, after = (float(np.median([error[key] for error in errors])) for key in ("before", "after"))
    return [
        at_least("multiarm: held-out free run, times better than viscous", before / after, 3.5),
        at_most("multiarm: coefficients of unphysical sign", unphysical(diagnosis), 0),
        at_least("multiarm: remainder admitted", float(diagnosis.verdict in ("partly_explained", "unexplained")), 1),
    ]


def dfki_bars(folder: Path) -> list[Bar]:
    """Results for geared motors at zero torque, with static friction and rotor inertia.

    One release is fitted, and the other release is held out.
    """
    rig = dfki_rig(json.loads((folder / "release_060143.json").read_text(encoding="utf-8")))
    runs = [import_csv(file, rig, ImportOptions(zero="hanging")) for file in sorted(folder.glob("*.csv"))]
    result = [diagnose([fitted], rig, held_out=[unseen]) for fitted, unseen in _each_held_out(runs)]
    worse = [entry for entry in result if _claims(entry) and min(entry.gap.closed_held_out.held_out.values()) < 0]
    names = {effect.name for entry in result for effect in entry.effects}
    return [
        at_least("dfki: stiction appears", float(any(name.startswith(DRY) for name in names)), 1),
        at_least("dfki: rotor inertia appears", float("rotor_inertia_joint2" in names), 1),
        at_most("dfki: claims that make a held-out release worse", float(len(worse)), 0),
    ]


def _each_held_out(runs: list[Run]) -> list[tuple[Run, Run]]:
    return [(runs[0], runs[1]), (runs[1], runs[0])]


def _claims(diagnosis: Diagnosis) -> bool:
    named = diagnosis.verdict in ("named", "partly_explained")
    return named and any(effect.probability > CLAIMED for effect in diagnosis.effects)


def unphysical(diagnosis: Diagnosis) -> float:
    """Return the number of friction coefficients and positive amplitudes that a diagnosis estimates below zero."""
    signs = {(e.name, p.name) for e in EFFECTS.values() for p in e.amplitudes if p.sign == "positive"}
    effects = [v.value for e in diagnosis.effects for name, v in e.parameters.items() if (e.name, name) in signs]
    return float(
        sum(value < 0 for value in [*effects, *(diagnosis.all_ratios[name].value for name in ("c1/b", "c2/b"))])
    )


def geared(rig: Rig) -> Rig:
    """Return a rig with geared motors on both joints."""
    return rig.model_copy(update={"joints": Joints(geared=(1, 2))})


def rezeroed(rig: Rig) -> Rig:
    """Return a rig whose encoders are zeroed before each recording."""
    return rig.model_copy(update={"encoders": rig.encoders.model_copy(update={"rezeroed": True})})


def dfki_rig(metadata: dict[str, Any]) -> Rig:
    """Rig with the parameters that its authors identified. Only the lengths count as measured values."""
    known = metadata["known_parameters"]
    model = known["model_1_0"]
    L1, L2 = known["l1_m"], known["l2_m"]
    nominal = {
        "l1": model["r1"],
        "l2": model["r2"],
        "m1": model["m1"],
        "m2": model["m2"],
        "mb": 0.01,
        "c1": max(model["b1"], 1e-3),
        "c2": max(model["b2"], 1e-3),
        "J1": max(model["I1_pivot"] - model["m1"] * model["r1"] ** 2, 1e-3),
        "J2": max(model["I2_pivot"] - model["m2"] * model["r2"] ** 2, 1e-3),
    }
    parameters = {
        name: Parameter(nominal=nominal[name], lower=nominal[name] / FIXED, upper=nominal[name] * FIXED)
        for name in PARAMETERS
    }
    counts = round(2 * np.pi / metadata["quantisation_step_rad"])
    return Rig(
        rig=RigGeometry(name="dfki_design_a", L1=L1, L2=L2),
        parameters=parameters,
        encoders=Encoders(counts_per_rev=(counts, counts, counts)),
    )
