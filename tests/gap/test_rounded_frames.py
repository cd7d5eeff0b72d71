"""Even time stamps of unevenly spaced frames are detected and replaced, and correct ones are kept."""

import numpy as np
import pytest
from numpy.typing import NDArray

from dpr_lab.gap.screen import sensor_faults
from dpr_lab.gap.screen.stamps.rounded_frames import rounded_frames
from dpr_lab.rig import load_rig
from dpr_lab.run import Run
from tests.gap.test_instants import readings

ROWS = 160


def swing(instants: NDArray[np.float64], noise: float = 1e-3, seed: int = 0) -> NDArray[np.float64]:
    """(n, 1) rad: a slowly damped rod with a period of 1.5 s."""
    angle = 1.2 * np.exp(-instants / 20) * np.cos(4.2 * instants)
    return (angle + noise * np.random.default_rng(seed).standard_normal(len(instants)))[:, None]


def frames(rate_hz: float, film_hz: float) -> NDArray[np.float64]:
    return np.floor(np.arange(ROWS) * film_hz / rate_hz + 0.3) / film_hz


@pytest.mark.parametrize(
    ("rate_hz", "film_hz", "apart"),
    [(8.0, 30.0, (3, 4)), (10.0, 24.0, (2, 3)), (20.0, 25.0, (1, 2)), (8.0, 30.0 / 1.001, (3, 4))],
)
def test_rows_of_a_film_are_at_its_frames(rate_hz: float, film_hz: float, apart: tuple[int, int]) -> None:
    taken = frames(rate_hz, film_hz)
    film = rounded_frames(np.arange(ROWS) / rate_hz, swing(taken))
    assert film is not None
    assert (film.film_hz, film.frames) == (film_hz, apart)
    assert np.std(film.instants - taken) < (1e-9 if film_hz.is_integer() else 0.1 / film_hz)


def test_an_outlier_does_not_hide_the_frames() -> None:
    readings = swing(frames(8.0, 30.0))
    readings[ROWS // 2] += 1.0
    film = rounded_frames(np.arange(ROWS) / 8.0, readings)
    assert film is not None
    assert film.film_hz == 30.0


def test_a_lost_row_does_not_hide_the_frames() -> None:
    taken, stamps = (np.delete(instants, 70) for instants in (frames(8.0, 30.0), np.arange(ROWS) / 8.0))
    film = rounded_frames(stamps, swing(taken))
    assert film is not None
    assert (film.film_hz, film.frames) == (30.0, (3, 4))
    assert np.std(film.instants - taken) < 1e-9


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("rate_hz", [6.0, 8.0, 12.0, 20.0, 30.0])
@pytest.mark.parametrize("noise", [1e-4, 1e-2])
def test_correct_stamps_are_kept(rate_hz: float, noise: float, seed: int) -> None:
    even, film = np.arange(ROWS) / rate_hz, frames(rate_hz, 50.0)
    assert rounded_frames(even, swing(even, noise, seed)) is None
    assert rounded_frames(even, readings(even, noise, seed)) is None or rate_hz < 12.0  # its 2.4 Hz need 12 rows
    assert rounded_frames(film, swing(film, noise, seed)) is None or rate_hz == 25.0


def test_the_screen_uses_the_frames() -> None:
    taken = frames(8.0, 30.0)
    stamps = np.arange(ROWS) / 8.0
    theta = np.hstack([np.zeros((ROWS, 1)), swing(taken), np.zeros((ROWS, 1))])
    run = Run("film", stamps, theta, None, None, "rig", "", 8.0)
    corrected, (finding,) = sensor_faults._on_true_instants(run, load_rig("paper"))
    assert finding.name == "rounded_frames"
    assert "3 or 4 frames apart in a film of 30 frames per second" in finding.evidence
    assert np.std(corrected.t - taken) < 1e-9
