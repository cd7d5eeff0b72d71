from dataclasses import replace

import numpy as np

from dpr_lab.drift.changes import Difference, Drift, ParameterChange
from dpr_lab.drift.estimates import Estimates
from dpr_lab.report.drift import basis_sentence, change_table, chart, group_table, relative, sentence, unit_of


def moved(name: str = "c2/b", first: float = 0.2, change: float = 0.03) -> ParameterChange:
    ends = (change - 0.005, change + 0.005)
    return ParameterChange(
        name=name,
        first=first,
        scatter=1e-3,
        differences=(Difference(1, change, ends), Difference(2, change, ends)),
        after=0,
        step=change,
        step_interval=ends,
        between=("2026-11-16", "2026-11-18"),
        change=change,
        change_interval=ends,
        p=1e-4,
        moved=True,
    )


def drift(*parameters: ParameterChange) -> Drift:
    days = ("2026-11-16", "2026-11-17", "2026-11-18")
    return Drift(days, (3, 3, 3), parameters, "runs of one group", 3.5, 0.012)


def test_the_verdict_names_the_groups_between_which_a_parameter_changed() -> None:
    other = replace(moved("a/b"), between=("2026-11-16", "2026-11-17"))
    assert "c2/b by +15 % between 2026-11-16 and 2026-11-18" in sentence(drift(moved(), other))
    (row,) = change_table(drift(moved())).rows
    assert "2026-11-16 and 2026-11-18" in row
    assert [row[1] for row in group_table(drift(moved())).rows] == [
        "2026-11-17 minus 2026-11-16",
        "2026-11-18 minus 2026-11-16",
    ]


def test_groups_that_differ_in_all_parameters_are_named_once() -> None:
    text = sentence(drift(moved("a/b"), moved("c2/b")))
    assert "2 of 2 parameters between 2026-11-16 and 2026-11-18: a/b by +15 %, c2/b by +15 % (9 runs" in text


def test_a_change_from_about_zero_is_absolute() -> None:
    assert relative(moved(first=1e-5), 0.03) == "+0.03 1/s"


def test_values_have_their_unit() -> None:
    units = {
        "a/b": "",
        "e1/b": "1/s²",
        "b": "kg m²",
        "coulomb_joint2.torque_Nm": "N m",
        "coulomb_joint2.torque_Nm/b": "1/s²",
        "friction_drift_joint1.rate_Nm_per_rad/b": unit_of("friction_drift_joint1.rate_Nm_per_rad/a"),
    }
    assert {name: unit_of(name) for name in units} == units
    (row,) = change_table(drift(moved("coulomb_joint2.torque_Nm/b", first=1e-5))).rows
    assert [row[2], row[3]] == ["1e-05 1/s²", "+0.03 1/s²"]
    assert row[4].endswith(" 1/s²")


def test_ratios_of_sizes_are_explained() -> None:
    assert "ratios to b" in basis_sentence(drift(moved("coulomb_joint2.torque_Nm/b")))
    assert "ratios to b" not in basis_sentence(drift(moved("c2/b")))


def test_the_control_chart_shows_group_after_group_although_they_alternate_in_time() -> None:
    values = np.array([[0.20], [0.23], [0.21], [0.24]])
    estimates = Estimates(("a", "b", "c", "d"), ("X1",) * 4, ("c2/b",), values, np.full((4, 1), 1e-3))
    two = Drift(("before", "after"), (2, 2), (moved(),), "runs of one group", 3.5, 0.012)
    (axes,) = chart(two, estimates, [0, 1, 0, 1]).axes
    drawn = next(line for line in axes.lines if len(np.atleast_1d(line.get_ydata())) == 4)
    assert np.allclose(drawn.get_ydata(), [0.0, 5.0, 15.0, 20.0])
    assert axes.get_xticks().tolist() == [0.5, 2.5]
