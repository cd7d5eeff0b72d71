import time
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.cli.identify import show
from dpr_lab.identification.model import EstimatedValue
from dpr_lab.identification.moving_arm.identify import ArmComparison
from dpr_lab.report import moving_arm, run_names, tables
from dpr_lab.report.data_frame import to_dataframe
from dpr_lab.report.figures import error_figure, response_figure


@pytest.mark.parametrize("table", [tables.ratio_table, tables.parameter_table, tables.run_table, tables.search_table])
def test_every_row_fills_its_columns(table, model):
    made = table(model())

    assert made
    assert all(len(row) == len(made.columns) and all(isinstance(cell, str) for cell in row) for row in made.rows)


def test_ratios_come_with_uncertainty_interval_and_unit(model):
    rows = tables.ratio_table(model()).rows

    assert [row[0] for row in rows] == ["a/b", "d/b", "e1/b", "c1/b", "c2/b"]
    assert rows[0] == ["a/b", "10.246 ± 0.010", "10.225 to 10.266", "1"]
    assert [row[3] for row in rows] == ["1", "1", "1/s²", "1/s", "1/s"]


def test_a_parameter_states_its_source_and_a_bound_has_no_uncertainty(model):
    rows = {row[0]: row for row in tables.parameter_table(model()).rows}

    assert len(rows) == 9
    assert [*rows["m1"][1:2], *rows["m1"][3:5]] == ["0.2000 ± 0.0010", "kg", "a measured value"]
    assert [*rows["J2"][1:2], *rows["J2"][3:5]] == ["0.2", "kg m²", "only its bounds"]
    assert rows["c1"][4] == "the recordings"
    assert "the value together with the known scale" in tables.parameter_note(model())


def test_base_parameters_are_listed_if_the_scale_is_known(model, capsys):
    whole = model()
    bound = {name: value.model_copy(update={"fixed_by": "bound", "std": None}) for name, value in whole.base.items()}
    identified = {
        name: value.model_copy(update={"fixed_by": "data", "std": 1e-3}) for name, value in whole.base.items()
    }

    assert tables.base_table(whole.model_copy(update={"base": bound})).rows == []
    rows = tables.base_table(whole.model_copy(update={"base": identified})).rows
    assert [row[0] for row in rows] == ["a", "b", "d", "e1", "c1", "c2"]
    assert all(len(row) == 4 and "±" in row[1] for row in rows)
    show(whole.model_copy(update={"base": identified}))
    assert "because the scale is known" in capsys.readouterr().out


def test_one_rod_has_one_residual(model, comparison):
    both = comparison()
    alone = replace(both, measured=both.measured[:, [0, 0]])
    assert [len(tables.comparison_table([made]).rows[0][3].split(", ")) for made in (both, alone)] == [2, 1]
    assert ["theta2" in repr(made) for made in (both, alone)] == [True, False]
    assert [len(to_dataframe(made).columns) for made in (both, alone)] == [6, 3]
    assert [len(response_figure([made]).axes) for made in (both, alone)] == [2, 1]
    assert [len(error_figure([made]).axes) for made in (both, alone)] == [4, 2]
    whole = model()
    assert "θ1, θ2" in tables.summary(whole)
    single = whole.model_copy(update={"fitted": [*whole.ratios.values()], "warnings": ["lacks an effect"]})
    assert "θ1:" in tables.summary(single)
    assert repr(single).splitlines()[0].endswith(" mrad (theta1); warning: lacks an effect")


def test_a_compared_run_in_mrad_and_times_noise(comparison):
    (row,) = tables.comparison_table([comparison(held_out=True, residual=2.0)]).rows

    assert len(row) == 8
    assert row[:3] == ["X1 first", "held out", "4"]
    assert row[3:6] == ["0.400, 0.600", "0.200, 0.300", "2.00, 2.00"]
    assert row[7] == "1.20"


def test_a_horizon_beyond_the_record_is_only_bounded_from_below(comparison):
    whole = comparison()

    (row,) = tables.comparison_table([replace(whole, horizon_s=float(whole.t[-1]))]).rows

    assert row[7] == "≥ 2.00"


def test_a_run_without_pose_or_noise_floor_shows_dashes(comparison):
    (row,) = tables.comparison_table([replace(comparison(pose=None), noise_rad=np.zeros(2))]).rows

    assert row[0] == "first"
    assert row[5] == "–, –"


@pytest.mark.parametrize(
    ("times_noise", "verdict"),
    [
        (1.0, "The residual is at the noise floor (rms residual"),
        (3.4, "the model lacks an effect, or the noise floor is underestimated. dpr-lab diagnose tests both (rms"),
        (0.5, "0.500 times the noise floor, so noise floor and intervals are overestimated"),
    ],
)
def test_the_summary_judges_the_residual_by_the_noise_floor(times_noise, verdict, model):
    sentence = tables.summary(model(times_noise))

    assert verdict in sentence
    assert "no run held out" in sentence
    assert ("dpr-lab diagnose also detects effects" in sentence) == (times_noise <= 1.0)


@pytest.mark.parametrize(("chi2", "noise"), [(0.7, True), (1.3, False)])
def test_noise_of_a_prescribed_arm_is_no_missing_effect(chi2, noise, model):
    fitted = model(1.5)
    fitted = fitted.model_copy(update={"fit": fitted.fit.model_copy(update={"chi2_per_dof": chi2})})
    sentence = tables.summary(fitted)
    assert ("is 1.50 times the noise of the readings. Noise alone explains this" in sentence) == noise
    assert ("lacks an effect" in sentence) != noise


@pytest.mark.parametrize("residual", [2.0, float("nan")])
def test_noise_on_the_fit_is_not_enough_when_a_held_out_run_is_worse(residual, model, comparison):
    compared = [comparison(), comparison("second", held_out=True), comparison("third", held_out=True)]
    compared[2] = replace(compared[2], segment_rms_rad=residual * compared[2].noise_rad)

    sentence = tables.summary(model(), compared)

    assert sentence.startswith("The residual of the fitted runs is at the noise floor; the residual of the held-out")
    assert "2 runs held out" in sentence


def test_a_used_run_does_not_count_as_held_out(model, comparison):
    assert "no run held out" in tables.summary(model(), [comparison(residual=5.0)])


def test_a_model_with_failed_checks_is_not_reliable(model):
    sentence = tables.summary(model(failures=["did not converge"]))

    assert sentence == "Not reliable: did not converge."


def test_without_a_noise_floor_there_is_no_verdict(model):
    whole = model()
    fit = whole.fit.model_copy(update={"noise_rad": {"theta1": 0.0, "theta2": 0.0}})

    assert tables.summary(model(fit=fit)).startswith("The noise floor is unknown")


def test_compared_runs_stand_side_by_side_in_80_columns_by_pose_and_local_time(comparison, monkeypatch):
    # File names of 28 characters made a block of nine lines of each run.
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()
    try:
        table = tables.comparison_table([comparison("20261121T101500Z_X1_00000001", held_out=True)])
    finally:
        monkeypatch.undo()
        time.tzset()

    assert table.rows[0][0] == "X1 (2026-11-21 11:15 CET)"
    words = [
        max(len(word) for cell in column for word in cell.split())
        for column in zip(table.columns, *table.rows, strict=True)
    ]
    assert sum(words) + 3 * len(words) + 1 <= 80


def test_a_note_states_standard_deviations_that_misfit_inflates(model):
    assert tables.ratio_note(model()) == tables.RATIO_NOTE
    least = {name: ratio.std / 20 for name, ratio in model().ratios.items()}
    note = tables.ratio_note(model(cramer_rao_std=least))
    assert "misfit inflation" in note
    assert "up to 20.0 times the Cramér-Rao values" in note


def test_the_tables_of_a_moving_arm_state_units_and_label_runs_like_those_of_a_clamped_arm() -> None:
    value = EstimatedValue(value=111.4, std=0.1, interval90=(111.2, 111.6), fixed_by="data")
    names = ("e1/a", "A/a", "kt/(R a)")
    rows = tables.ratio_table(Mock(ratios=dict.fromkeys(names, value))).rows
    assert {row[0]: row[3] for row in rows} == {"e1/a": "1/s²", "A/a": "1", "kt/(R a)": "1/(s² V)"}
    name = "20261121T101500Z_X1_00000001"
    size = {"joint 0": 1e-3}
    runs = [{"run": name, "held_out": False, "truncated": False, "segment_s": 0.5, "rms_rad": size, "noise_rad": size}]
    table = moving_arm.comparison_table({"runs": runs})
    ((label, _, _, segment, *_),) = table.rows
    assert (segment, table.columns[3]) == ("0.5", "segment (s)")
    assert label == run_names.run_name(Path(f"{name}.mcap")) != name


@pytest.mark.parametrize(
    ("run", "pose", "label"),
    [
        ("swing", "X1", "X1 swing"),
        ("side", "side", "side"),
        ("swing", None, "swing"),
        ("lab_X12", "X1", "X1 lab_X12"),
        ("lab_X1", "X1", "lab_X1"),
    ],
)
def test_a_compared_run_has_the_name_of_its_pose_once(run: str, pose: str | None, label: str) -> None:
    assert run_names.compared_name(Mock(run=run, pose=pose)) == label


def test_the_table_of_a_comparison_contains_rods_without_an_encoder():
    """A corrected model of a single rod has no angle of joint 2; its table was empty."""
    angles = np.array([[0.1, 3.1, np.nan], [0.2, 3.2, np.nan], [np.nan, np.nan, np.nan]])
    compared = ArmComparison("r1", True, np.arange(3.0), angles, angles, 0.5, {"joint 0": 0.0}, {"joint 0": 1e-3})
    _, *rows = moving_arm.angles_csv([compared]).splitlines()
    assert rows == ["r1,0,0.1,3.1,nan,0.1,3.1,nan", "r1,1,0.2,3.2,nan,0.2,3.2,nan"]
