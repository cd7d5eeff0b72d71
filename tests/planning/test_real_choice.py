"""The benchmark on real recordings fits the recording first whose range contains the states of the others."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest


def test_the_recording_that_reaches_the_others_is_fitted_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    import plan_real

    t = np.arange(0.0, 4.0, 1e-3)

    def swing(amplitude: float, turns: int = 0) -> Any:
        relative = amplitude * np.sin(5 * t)
        return SimpleNamespace(t=t, joints=np.column_stack([np.pi + relative + 2 * np.pi * turns, relative]))

    monkeypatch.setattr(plan_real, "record", lambda run, rig: run)
    runs: Any = [swing(0.3), swing(2.0, turns=-1), swing(1.0)]
    narrow, wide, middle = plan_real.covered_shares(None, runs)
    assert wide == 1.0
    assert middle == pytest.approx(0.5, abs=0.01)  # the wide one is fast where it is near hanging
    assert narrow < 0.01
    assert plan_real.choices(runs, 2) == [(0, 1), (0, 2), (1, 2)]
    with_wide, without_wide, both = plan_real.covered_shares(None, runs, 2)
    assert with_wide == both == 1.0
    assert without_wide < 0.3


def test_without_a_held_out_recording_the_number_of_fitted_ones_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    import plan_real

    monkeypatch.setattr(plan_real, "SETS", {"multiarm": lambda folder: (None, [None] * 5)})
    monkeypatch.setattr("sys.argv", ["plan_real.py", "--data", ".", "--quick", "--fitted", "3"])
    with pytest.raises(SystemExit):
        plan_real.main()
    assert "--fitted must be from 1 to 2: multiarm has 3 recordings" in capsys.readouterr().err
