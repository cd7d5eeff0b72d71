"""Films of two rods whose tracked points wander: neighbouring frames have correlated errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.which.applicable import applicable
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure
from tests.bench_rigs import rods_swing
from tests.thinned import thinned

RATE_HZ = 60.0
CORRELATION = 0.92
ERROR_M = 0.002
"""Of the elbow; of the tip twice as much."""


def wandering(rng: np.random.Generator, frames: int, columns: int) -> np.ndarray:
    """(frames, columns) process of first order with unit variance."""
    errors = rng.normal(0, 1, (frames, columns))
    for k in range(1, frames):
        errors[k] = CORRELATION * errors[k - 1] + np.sqrt(1 - CORRELATION**2) * errors[k]
    return errors


def filmed(seed: int, folder: Path, dry2: float = 0.0) -> tuple[Rig, Run]:
    """Two uniform rods, filmed for 2.5 s; dry friction of joint 2 relative to the inertia of the outer rod, 1/s^2."""
    rng, g = np.random.default_rng(seed), 9.81
    L1, L2 = rng.uniform(0.12, 0.25, 2)
    m1, m2 = rng.uniform(0.02, 0.05, 2)
    b = m2 * L2**2 / 3
    p = {"a": m1 * L1**2 / 3 + m2 * L1**2, "b": b, "d": m2 * L1 * L2 / 2}
    p |= {"e1": (m1 / 2 + m2) * g * L1, "e2": m2 * g * L2 / 2, "c1": 1e-2 * b, "c2": 1e-2 * b}
    p |= dict.fromkeys(("f1", "drag", "drag2", "rotor"), 0.0) | {"f2": dry2 * b}
    t = np.arange(0, 2.5, 1 / RATE_HZ)
    q = rods_swing(p, rng.uniform([0.8, 0.8], [1.6, 1.6]), t)
    elbow, rod2 = (length * np.column_stack([np.sin(q[:, k]), -np.cos(q[:, k])]) for k, length in enumerate((L1, L2)))
    points = np.column_stack([elbow, elbow + rod2]) + ERROR_M * np.array([1, 1, 2, 2]) * wandering(rng, len(t), 4)
    file = folder / "film.csv"
    np.savetxt(file, np.column_stack([t, points]), delimiter=",", header="t,x1,y1,x2,y2", comments="", fmt="%.6f")
    rig = parse_rig(draft_rig(RigMeasures("film", L1, L2, Measure(m1), Measure(m2))))
    return rig, import_csv(file, rig)


@pytest.mark.slow
@pytest.mark.parametrize("seed", thinned([1, 5], 2))
def test_errors_of_a_tracker_are_not_a_gap(tmp_path: Path, seed: int) -> None:
    rig, run = filmed(seed, tmp_path)
    diagnosis = diagnose(run, rig)
    assert diagnosis.verdict == "inconclusive"
    assert not diagnosis.model_effects


@pytest.mark.slow
def test_friction_is_found_behind_the_errors_of_a_tracker(tmp_path: Path) -> None:
    rig, run = filmed(12, tmp_path, dry2=10.0)
    diagnosis = diagnose(run, rig)
    assert diagnosis.verdict == "named"
    assert [effect.name for effect in diagnosis.effects] == ["coulomb_joint2"]


@pytest.mark.slow
def test_angles_of_points_do_not_depend_on_counts_per_turn(tmp_path: Path) -> None:
    """In a small swing a wrong scale of an encoder would resemble a wrong length."""
    rig, run = filmed(1, tmp_path)
    counted = {name for name, effect in EFFECTS.items() if effect.corrects == "counts_per_rev"}
    for tracked, expected in ((run, set()), (replace(run, film_noise=None), counted - {"encoder_scale_joint0"})):
        recordings = Recordings((record(tracked, rig),), rig)
        _, problem, _ = fit_bare_model(recordings, nominal_ratios(rig))
        result = applicable(EFFECTS, problem, of_points=recordings.of_points)
        assert counted & result.keys() == expected
