"""The benchmark of the forecast keeps each single forecast, and a later run extends the file."""

from dataclasses import replace
from pathlib import Path

import pytest

from dpr_lab.trials.score import Claim


def test_a_later_run_extends_the_file_and_a_plant_without_forecast_counts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    from _stored_forecasts import Forecast, claims_by_plant, store, stored

    file, one = (
        tmp_path / "out" / "forecasts.csv",
        Forecast("mujoco", "2026-11-30", 5, 1, "named", "record", 1, 0.25, True),
    )
    undecided, ended = replace(one, further=2, probability=0.5, true=False), replace(one, seed=3, further=0)
    ended = replace(ended, plan="enough", probability=None, true=None)
    assert stored(file, "mujoco") == []
    store(file, [one, undecided])
    store(file, [ended, replace(one, plants="single:faint", seed=9)])
    assert stored(file, "mujoco") == [one, undecided, ended]
    store(file, [replace(one, version="0.1.0")])
    with pytest.raises(ZeroDivisionError):  # a plant is stored completely or not at all
        store(file, (replace(one, further=1 // number) for number in (1, 0)))
    assert stored(file, "mujoco") == [one, undecided, ended]
    assert claims_by_plant(stored(file, "mujoco")) == [[], [Claim(0.25, True), Claim(0.5, False)]]


def test_a_file_without_versions_is_not_extended(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    from _stored_forecasts import stored

    file = tmp_path / "forecasts.csv"
    file.write_text("plants,date,seed,recorded,verdict,plan,further,probability,true\n")
    with pytest.raises(SystemExit, match="use another file"):
        stored(file, "mujoco")
