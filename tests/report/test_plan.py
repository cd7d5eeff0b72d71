"""Standard deviations of the ratios in a plan."""

from dpr_lab.planning.result import Plan, PlannedRelease
from dpr_lab.report.tables import ratio_std_table


def test_before_any_recording_the_rig_file_bounds_the_rods_only_and_each_ratio_has_its_unit() -> None:
    release = PlannedRelease.model_construct(ratio_std={"c1/a": 1e-4, "kt/(R a)": 0.012})
    first = Plan.model_construct(state="first", ratio_std={"c1/a": 36.0, "kt/(R a)": 1.3e7})
    assert ratio_std_table(first, release).rows == [
        ("c1/a", "36", "0.0001", "1/s"),
        ("kt/(R a)", "unknown", "0.012", "1/(s² V)"),
    ]
    later = first.model_copy(update={"state": "record", "ratio_std": {"kt/(R a)": 0.5}})
    assert ratio_std_table(later, release).rows == [("kt/(R a)", "0.5", "0.012", "1/(s² V)")]
