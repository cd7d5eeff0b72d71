"""Lost frames that the times do not show: the steps of the angles do."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.rig import load_rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.tables.questions.lost_frames import long_steps

RIG = load_rig("paper")
FPS, N, NOISE = 60.0, 240, 5e-4
T = np.arange(N) / FPS
SWING = simulate(base_parameters(RIG.nominal, RIG.L1, RIG.g), RIG.L1, RIG.g, [2.0, 1.2, 0, 0], T)[:, :2]
THETA = SWING + NOISE * np.random.default_rng(0).standard_normal((N, 2))
EVERY_FOURTH = np.arange(N) % 4 != 3
RANDOM = np.random.default_rng(1).random(N) > 0.1


def evenly_stamped(kept: np.ndarray) -> np.ndarray:
    """Return even times that last as long as the recording."""
    return np.linspace(0.0, T[kept][-1], int(kept.sum()))


@pytest.mark.parametrize("kept", [EVERY_FOURTH, RANDOM], ids=["every fourth", "one in ten"])
@pytest.mark.parametrize("rods", [[0], [0, 1]])
def test_lost_frames_are_found_in_the_steps(kept: np.ndarray, rods: list[int]) -> None:
    lost = int((np.diff(np.flatnonzero(kept)) > 1).sum())
    long, steps = long_steps(evenly_stamped(kept), THETA[kept][:, rods])
    assert steps == kept.sum() - 1
    assert abs(long - lost) <= 0.15 * lost


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.03])
def test_complete_films_have_no_long_steps(noise: float) -> None:
    """Noise, uneven exposures and a stamp that shows the gap do not count as lost frames."""
    rng = np.random.default_rng(2)
    noisy = SWING + noise * rng.standard_normal((N, 2))
    assert long_steps(T, noisy)[0] == 0
    assert long_steps(T[EVERY_FOURTH], noisy[EVERY_FOURTH])[0] == 0  # the times show the gaps
    exposed = T + rng.uniform(-0.3, 0.3, N) / FPS
    uneven = np.stack([np.interp(exposed, T, column) for column in noisy.T], axis=1)
    assert long_steps(T, uneven)[0] == 0


def test_steps_of_few_counts_are_not_examined() -> None:
    """The steps of a coarse encoder are whole multiples of a count."""
    coarse = np.radians(2.0) * np.rint(SWING / np.radians(2.0))
    assert long_steps(T, coarse) == (0, 0)


def test_a_single_repeated_reading_or_outlier_is_no_lost_frame() -> None:
    faulty = THETA.copy()
    faulty[100] = faulty[99]
    faulty[150] += 0.5
    assert long_steps(T, faulty)[0] == 0


@pytest.mark.parametrize(("kept", "warned"), [(EVERY_FOURTH, True), (np.ones(N, dtype=bool), False)])
def test_the_import_names_the_lost_frames(tmp_path: Path, kept: np.ndarray, warned: bool) -> None:
    rows = "\n".join(f"{t:.6f},{a:.6f},{b:.6f}" for t, (a, b) in zip(evenly_stamped(kept), THETA[kept], strict=True))
    (tmp_path / "film.csv").write_text(f"t,theta1,theta2\n{rows}\n", encoding="utf-8")
    notes = import_csv(tmp_path / "film.csv", RIG).notes
    assert any("frames or rows were lost without an interruption of the times" in note for note in notes) == warned
