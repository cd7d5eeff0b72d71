from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dpr_lab.gap.result.checks import PLUMB_LINE
from dpr_lab.gap.result.diagnosis import UNCERTAIN, Diagnosis
from dpr_lab.gap.result.evidence import Budget, Curves, Evidence, JointFriction, ResidualAnalysis, RunBudget, Whiteness
from dpr_lab.gap.result.gap_size import Where
from dpr_lab.gap.transfer.gap_size import _per_reading
from dpr_lab.report.gap import tables as gap_tables
from dpr_lab.report.gap.check_tables import check_table
from dpr_lab.report.gap.figures import save_gap_figures, where_figure
from dpr_lab.report.gap.findings import finding_table
from dpr_lab.report.gap.html import write_gap_report
from dpr_lab.report.gap.next_steps import next_steps
from dpr_lab.report.gap.sections.friction import friction_figure, friction_table, friction_words
from dpr_lab.report.gap.sections.metric import metric_figure
from dpr_lab.report.gap.sections.residuals import RESIDUALS
from dpr_lab.report.gap.summary import basis_words, budget_bar, summary_note
from dpr_lab.report.style import house_style
from dpr_lab.report.words import in_words, named

OUTSIDE, REMAINDER = 0.2, 0.1
COULOMB, TILT = named("coulomb_joint1"), named("base_tilt")
RELEASE = {
    "id": "1-ab", "kind": "recording", "text": "Record a release.", "about": "coulomb_joint1",
    "splits": ["coulomb_joint1", "stribeck_joint1"], "expected_bits": 0.6,
}  # fmt: skip
BENCH = RELEASE | {
    "id": "2-ab", "text": "Lay a level on the arm.", "about": "base_tilt",
    "splits": ["base_tilt", "encoder_offset_joint1"],
}  # fmt: skip


def effect(name: str, probability: float, share: float, *indistinguishable: str) -> dict:
    size = {"torque_Nm": {"value": 0.002, "interval90": (0.0019, 0.0021)}}
    return {
        "name": name,
        "class": [name, *indistinguishable],
        "probability": probability,
        "parameters": size,
        "share": share,
    }


def rival(name: str, probability: float, instead_of: str) -> dict:
    return {"name": name, "class": [name], "probability": probability, "cosine": 0.9, "instead_of": instead_of}


@pytest.fixture
def diagnosis():
    """Create a diagnosis of two effects, one with a probable alternative and one in a class of two."""

    def make(**changes) -> Diagnosis:
        by_joint = {"joint1": 3e-3, "joint2": 4e-3}
        fields = {
            "verdict": "partly_explained",
            "sentence": "Partly explained.",
            "gap": {
                "floor_rad": dict.fromkeys(by_joint, 1e-4),
                "before_rad": by_joint,
                "after_rad": dict.fromkeys(by_joint, 1e-3),
                "explained_share": 1 - REMAINDER,
                "closed_held_out": {"estimate": 0.7, "interval90": (0.6, 0.8), "per_run": {"first": 0.7}},
                "waterfall": [
                    {"effect": "coulomb_joint1", "rms_rad": 2.5e-3},
                    {"effect": "base_tilt", "rms_rad": 1.6e-3},
                ],
            },
            "where": [],
            "where_sentence": "Somewhere.",
            "effects": [
                effect("coulomb_joint1", 0.6, 0.8),
                effect("base_tilt", 0.8, 0.3, "encoder_offset_joint1"),
            ],
            "rivals": [
                rival("stribeck_joint1", 0.15, "coulomb_joint1"),
                rival("coulomb_joint2", 2e-22, "coulomb_joint1"),
                rival("spring_joint1", 1e-22, "coulomb_joint1"),
                rival("detent_joint1", 1e-22, "base_tilt"),
            ],
            "probabilities": {"no_gap": 0.0, "unexplained": OUTSIDE},
            "detectable": {},
            "sensor_findings": [],
            "advice": [],
            "checks": [RELEASE, BENCH],
            "ratios": {},
            "ratio_covariance": [],
            "chi2_per_dof": 2.0,
            "segments": 60,
            "scale_b": 0.004,
            "model_effects": {},
            "assumptions": [],
            "seconds": 1.0,
        }
        return Diagnosis.model_validate(fields | changes)

    return make


def test_a_residual_map_of_an_older_version_has_its_axis_label() -> None:
    older = Where(site="joint1", coordinate="load", share=0.5, sentence="There.", unit="N m")
    assert gap_tables.coordinate(older) == ("joint force (N)", 1.0)


def test_the_summary_of_the_report_does_not_list_increments_that_may_be_zero(diagnosis, tmp_path):
    sizes = {
        "forward_Nm": {"value": 0.001, "interval90": (0.0009, 0.0011)},
        "rise1_Nm": {"value": 0.0001, "interval90": (-0.0001, 0.0003)},
    }
    curve = effect("friction_curve_joint1", 0.9, 0.9) | {"parameters": sizes}
    result = diagnosis(effects=[curve], rivals=[])
    page = write_gap_report(result, "Curve", tmp_path, save_gap_figures(result, tmp_path)).read_text(encoding="utf-8")
    summary, details = page.split("<details", 1)
    assert "not distinguishable from zero: rise (0 to 0.3 rad/s)" in summary
    assert "0.100 mN m" not in summary
    assert "0.100 mN m (-0.100 to 0.300)" in details


def test_the_best_check_of_each_effect_is_recommended(diagnosis):
    bits = {"1-ab": 0.3, "2-ab": 0.6, "3-ab": 0.01}
    result = diagnosis(checks=[{**RELEASE, "id": name, "expected_bits": b} for name, b in bits.items()])
    purpose = f"Record a release. This distinguishes {COULOMB} from {named('stribeck_joint1')}."
    details = "check 2-ab, expected information 0.60 bits; or instead: check 1-ab"
    assert next_steps(result)[0] == f"{purpose} [{details}]"
    assert next_steps(result)[1].startswith("The remainder")


def test_at_most_three_checks_are_recommended(diagnosis):
    causes = ("a", "b", "c", "d")
    result = diagnosis(checks=[{**RELEASE, "id": f"{cause}-ab", "about": cause} for cause in causes])
    assert [step.split("[")[-1][:10] for step in next_steps(result)[:-1]] == ["check a-ab", "check b-ab", "check c-ab"]


def test_a_recording_precedes_a_measurement_with_as_much_information(diagnosis):
    quantity = {"name": "torque", "unit": "N m", "symbol": "C", "parameters": ["torque_Nm"]}
    bench = {**RELEASE, "id": "2-ab", "kind": "measurement", "measures": "coulomb_joint1", "quantity": quantity}
    measured = diagnosis(checks=[{**bench, "expected_bits": 0.62}, RELEASE])
    assert "[check 1-ab, expected information 0.60 bits; or instead: check 2-ab]" in next_steps(measured)[0]
    measured = diagnosis(checks=[{**bench, "expected_bits": 0.7}, RELEASE])
    assert "[check 2-ab, expected information at most 0.70 bits; or" in next_steps(measured)[0]


def test_checks_of_the_camera_are_shown_first(diagnosis):
    assert next_steps(diagnosis(verdict="named", checks=[], advice=["Use coulomb_joint1."])) == [f"Use {COULOMB}."]
    assert next_steps(diagnosis(advice=[PLUMB_LINE, "Record a release."]))[0] == PLUMB_LINE


@pytest.mark.parametrize(
    ("after", "words"),
    [
        (
            {"coulomb_joint1": 0.1, "stribeck_joint1": 0.8, "unexplained": 0.1},
            "Diagnose again with --without coul",
        ),
        (
            {"coulomb_joint1": 0.1, "stribeck_joint1": 0.1, "unexplained": 0.8},
            "None of the candidates explains",
        ),
    ],
)
def test_a_check_that_refutes_the_cause_comes_first(diagnosis, after, words):
    done = {"check": RELEASE, "result": "recorded", "before": after, "after": after}
    (step,) = next_steps(diagnosis(verdict="named", checks=[], checks_done=[done]))
    assert step.startswith(words)


def test_a_check_without_information_is_only_in_the_table(diagnosis):
    result = diagnosis(checks=[{**RELEASE, "expected_bits": 2e-4}])
    assert [step[:13] for step in next_steps(result)] == ["The remainder"]
    assert check_table(result).rows[0][-1] == "< 0.01"


def test_the_probabilities_of_the_alternatives_of_an_effect_add_up(diagnosis):
    rows = gap_tables.standing_table(diagnosis()).rows

    first_rows = [i for i, row in enumerate(rows) if row[0]]
    assert [rows[i][0] for i in first_rows] == [COULOMB, TILT]
    for first, last in zip(first_rows, [*first_rows[1:], len(rows)], strict=True):
        stated = [0.0 if "<" in row[2] else float(row[2].rstrip(" %")) for row in rows[first:last]]
        assert sum(stated) == pytest.approx(100, abs=0.5)


def test_each_alternative_has_a_way_to_distinguish_it(diagnosis):
    distinction = {row[1]: row[4] for row in gap_tables.standing_table(diagnosis()).rows}

    assert distinction[named("stribeck_joint1")] == "check 1-ab"
    assert distinction[f"{TILT} or {named('encoder_offset_joint1')}"] == "check 2-ab"
    assert distinction[named("coulomb_joint2")] == "these recordings"
    assert distinction["a cause outside the library"] == "10.0 % of the excess remains"
    assert not any("spring_joint1" in words for words in distinction)


def test_the_short_output_lists_only_effects_with_a_probable_alternative(diagnosis):
    table = gap_tables.open_table(diagnosis())
    assert [row[0] for row in table.rows if row[0]] == [COULOMB]
    assert gap_tables.open_table(diagnosis(rivals=[])) is None


def test_next_steps_end_with_the_remainder(diagnosis):
    steps = next_steps(diagnosis())

    assert [step.partition(" This")[0] for step in steps[:2]] == [RELEASE["text"], BENCH["text"]]
    assert "another cause" in steps[2]
    (undecided,) = next_steps(diagnosis(verdict="named", checks=[]))
    assert undecided.startswith("Record a further release")
    effects = [
        diagnosis().effects[0].model_copy(update={"probability": 0.98, "odds": {}, "members": ["coulomb_joint1"]})
    ]
    decided = diagnosis(verdict="named", checks=[]).model_copy(
        update={"effects": effects, "rivals": [], "evidence": None}
    )
    assert next_steps(decided) == ["No further recording or check is needed."]
    (step,) = next_steps(decided.model_copy(update={"basis": "one release", "posterior": []}))
    assert step.endswith("check is needed. Optional: a further release confirms the result under other conditions.")
    assert "Record further releases" in next_steps(diagnosis(verdict="inconclusive", checks=[]))[0]


def test_without_a_remainder_the_last_step_asks_for_more_releases(diagnosis):
    steps = next_steps(diagnosis(sentence=f"The gap is partly explained by {TILT}. {UNCERTAIN}"))

    assert "dpr-lab plan" in steps[2]


def test_a_remainder_below_the_noise_needs_no_inspection(diagnosis):
    gap = diagnosis().gap
    small = gap.model_copy(update={"after_rad": {joint: 0.5 * noise for joint, noise in gap.floor_rad.items()}})

    assert "smaller than the noise" in next_steps(diagnosis(gap=small))[2]


def test_steps_end_at_the_explained_share(diagnosis):
    assert gap_tables.step_table(diagnosis()).rows == [
        ("bare model", "3.54", "0.0 %"),
        (f"+ {COULOMB}", "1.77", "75.0 %"),
        (f"+ {TILT}", "1.13", "90.0 %"),
    ]


def test_without_a_named_effect_the_closest_one_is_listed(diagnosis):
    closest = rival("coulomb_joint1", 0.3, "")
    rows = gap_tables.standing_table(diagnosis(verdict="unexplained", effects=[], rivals=[closest])).rows

    assert [row[:3] for row in rows] == [
        (COULOMB, COULOMB, "30 %"),
        ("", "another alternative, or no effect", "50 %"),
        ("", "a cause outside the library", "20 %"),
    ]


def test_the_gap_of_every_step_is_that_of_a_reading(diagnosis):
    whole = diagnosis()
    named = [{"effect": "coulomb_joint1", "gap_rad": 1e-3, "rms_rad": 2e-3}]
    current = whole.model_copy(update={"gap": whole.gap.model_copy(update={"waterfall": named})})

    before = np.sqrt(np.mean(np.square(list(whole.gap.before_rad.values()))))
    assert gap_tables.steps(whole)[0][1] == pytest.approx(before)
    assert gap_tables.steps(whole)[1][1] == pytest.approx(2.5e-3 / np.sqrt(2))  # of an older file
    assert gap_tables.steps(current)[1][1] == 1e-3


@pytest.mark.parametrize("verdict", ["no_gap", "named", "partly_explained", "unexplained"])
def test_the_page_starts_with_the_verdict(diagnosis, tmp_path, verdict):
    result = diagnosis(verdict=verdict)

    figures = save_gap_figures(result, tmp_path)
    page = write_gap_report(result, "A & B", tmp_path, figures).read_text(encoding="utf-8")

    assert page.index("A &amp; B") < page.index("Partly explained.") < page.index("Effects and alternatives")
    assert page.count("<img") == 2  # waterfall and gap by segment length; no gap can be located
    assert page.count("<h2>") == page.count("<summary><h2>")  # all sections are folded
    assert ("Gap budget" in page) == (verdict != "no_gap")


def test_repeated_faults_share_one_row(diagnosis):
    def fault(name: str, time: float, run: str = "first") -> dict:
        return {"name": name, "run": run, "axis": "joint1", "at_s": time, "evidence": "It is off."}

    few = [fault("repeated_sample", 0.1 * i) for i in range(3)]
    many = [fault("outlier", 1.0 + i, run) for run in ("first", "second") for i in range(40)]
    rows = finding_table(diagnosis(sensor_findings=[*few, *many])).rows
    assert [row[3:] for row in rows[:3]] == [("0.000", "It is off."), ("0.100", "It is off."), ("0.200", "It is off.")]
    assert [row[3:] for row in rows[3:]] == [("1.000", "It is off; 80 times in 2 runs; this is the first")]


def test_knots_outside_the_recorded_range_are_not_drawn(diagnosis):
    place = {"site": "encoder1", "coordinate": "angle", "share": 0.5, "sentence": "There.", "unit": "rad"}
    knots = {"knots": [-1.0, 0.0, 1.0], "values": [0.0, 0.01, 0.02], "std": [1.7e305, 1e-3, 2e-3]}

    (axes,) = [axes for axes in where_figure(diagnosis(where=[place | knots])).axes if axes.get_visible()]

    np.testing.assert_allclose(np.asarray(axes.lines[0].get_ydata()), [np.nan, 10, 20])
    assert axes.get_ylim()[1] < 50


def test_an_improbable_alternative_of_the_same_shape_has_a_reason(diagnosis) -> None:
    alternatives = [
        rival("friction_curve_joint1", 1e-6, "coulomb_joint1") | {"cosine": 1.0},
        rival("hysteresis_joint1", 1e-6, "coulomb_joint1") | {"cosine": 0.9},
    ]
    rows = {row[1]: row[-1] for row in gap_tables.standing_table(diagnosis(rivals=alternatives)).rows}
    reasons = [reason for name, reason in rows.items() if "friction_curve_joint1" in name]
    assert "a more general form, which is not needed" in reasons[0]
    assert [reason for name, reason in rows.items() if "hysteresis_joint1" in name] == [gap_tables.SPLIT]


def test_the_gap_budget_adds_up(diagnosis) -> None:
    bar = budget_bar(diagnosis())
    assert bar is not None
    assert [share for _, share in bar.parts] == pytest.approx([0.5, 0.18, 0.32])
    assert bar.parts[0][0] == f"{COULOMB}: 1.77 mrad (50.0 %)"
    assert bar.parts[-1][0] == "remainder: 1.13 mrad (32.0 %)"
    named = budget_bar(diagnosis(verdict="named"))
    assert named is not None
    # reconciled with "nothing above the noise floor remains"
    square = "remainder: 1.13 mrad (32.0 %), 10.2 % of the mean square: only noise remains in the fit"
    assert named.parts[-1][0] == square


@pytest.mark.parametrize(
    ("held_out", "words"),
    [
        (["swing 10-20 s", "swing 30-40 s"], "held-out pieces of the recording"),
        (["swing 10-20 s", "low"], "held-out runs"),
        ([], "held-out runs"),
    ],
)
def test_held_out_pieces_of_one_recording_are_called_so(diagnosis, held_out: list[str], words: str) -> None:
    result = diagnosis(basis="held-out runs")
    closed = result.gap.closed_held_out.model_copy(update={"held_out": dict.fromkeys(held_out, 0.9)})
    gap = result.gap.model_copy(update={"closed_held_out": closed})
    assert basis_words(result.model_copy(update={"gap": gap})) == words


def test_an_improbable_effect_is_not_listed_as_a_cause(diagnosis, tmp_path) -> None:
    result = diagnosis(effects=[effect("coulomb_joint1", 0.0, 0.8), effect("base_tilt", 0.8, 0.3)])
    assert [row[0] for row in gap_tables.summary_table(result).rows] == [TILT]
    bar = budget_bar(result)
    assert bar is not None
    assert [label.split(":")[0] for label, _ in bar.parts] == ["terms without a probable cause", TILT, "remainder"]
    assert COULOMB in summary_note(result)
    assert summary_note(diagnosis()) == ""


def test_the_friction_torque_of_each_joint_is_shown_with_its_interval(diagnosis) -> None:
    curve = JointFriction(
        speed_rad_per_s=[-2.0, -0.02, 0.02, 2.0],
        torque_Nm=[-3e-3, -1e-3, 1e-3, 3e-3],
        std_Nm=[1e-5, 2e-5, 2e-5, 1e-5],
        coefficients=2,
    )
    made = diagnosis(effects=[effect("hysteresis_joint1", 0.9, 0.3)])
    made = made.model_copy(update={"evidence": Evidence.model_construct(friction={"joint1": curve})})
    joint, _, other = friction_words(made)
    assert joint.startswith("Joint 1: 1.000 ± 0.020 mN m at 0.0200 rad/s and 3.000 ± 0.010 mN m at 2.00 rad/s")
    assert named("hysteresis_joint1") in other
    assert friction_table(made).rows[0] == ("joint 1", "-2.00", "-3.000 ± 0.010", "-3.016 to -2.984")
    (axes,) = friction_figure(made).axes
    (band,) = axes.collections
    assert band.get_paths()[0].vertices[:, 1].min() == pytest.approx(-3.0 - 1.645e-2, abs=1e-5)


@pytest.mark.parametrize("joints", [("joint1",), ("joint1", "joint0"), ("joint1", "joint2", "joint0")])
def test_tables_of_residuals_have_the_joints_of_the_rig(diagnosis, joints: tuple[str, ...]) -> None:
    white = Whiteness(autocorrelation=[1.0, 0.0], quantiles=[-1.0, 1.0], beyond3=0.003)
    models = {"before": white, "after": white}
    look = ResidualAnalysis(spacing_s=5e-3, readings=100, normal=[-1.0, 1.0], joints=dict.fromkeys(joints, models))
    made = diagnosis().model_copy(update={"evidence": Evidence.model_construct(residuals=look)})
    for table in (table_of(made) for table_of in RESIDUALS.tables):
        assert {len(row) for row in table.rows} == {len(table.columns)}
        assert list(dict.fromkeys(row[0] for row in table.rows)) == [in_words(joint) for joint in joints]


@pytest.mark.parametrize("rods", [1, 2])
def test_the_area_metric_has_one_panel_for_each_rod(diagnosis, rods: int) -> None:
    t = np.linspace(0.0, 1.0, 11)
    angles = np.stack([np.sin(t), t], axis=1)
    measured, before, after = (factor * angles for factor in (1.0, 1.1, 1.01))
    curves = Curves(
        run="first", held_out=False, settled_s=0.0, until_s=1.0, t_s=t.tolist(), measured_rad=measured.tolist(),
        before_rad=before.tolist(), after_rad=after.tolist(), rods=rods,
    )  # fmt: skip
    budget = Budget.model_construct(runs=[RunBudget.model_construct(run="first", area_before_rad=0.1)])
    evidence = Evidence.model_construct(budget=budget, curves=[curves])
    with house_style():
        figure = metric_figure(diagnosis().model_copy(update={"evidence": evidence}))
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles == ["inner rod, first", "outer rod, first"][:rods]


def test_a_joint_without_readings_does_not_reduce_the_gap_per_reading(diagnosis: Callable[..., Diagnosis]) -> None:
    gap = diagnosis().gap
    assert gap_tables.per_reading(gap, "before_rad") == pytest.approx(12.5e-6**0.5)
    of_one_rod = gap.model_copy(update={"floor_rad": {"joint1": 1e-4, "joint2": 0.0}})
    assert gap_tables.per_reading(of_one_rod, "before_rad") == pytest.approx(3e-3)
    problem = cast(Any, SimpleNamespace(read=np.array([[True, False]] * 3)))
    assert _per_reading({"joint1": 3e-3, "joint2": 0.0}, problem) == pytest.approx(3e-3)
