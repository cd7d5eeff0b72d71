import numpy as np
import pytest

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.gap import tables as gap_tables
from dpr_lab.report.gap.figures import save_gap_figures, where_figure
from dpr_lab.report.gap.html import write_gap_report
from dpr_lab.report.words import in_words

OUTSIDE, LEFT = 0.2, 0.1
DRY, TILT = "Coulomb friction, joint 1 [coulomb_joint1]", "base tilt [base_tilt]"
TELLING = "To tell coulomb_joint1 from stribeck_joint1, record a release: they differ by 9 standard deviations there."
TWINS = "Only the bench tells base_tilt from encoder_offset_joint1: Lay a level on the arm."


def effect(name: str, probability: float, share: float, *twins: str) -> dict:
    size = {"torque_Nm": {"value": 0.002, "interval90": (0.0019, 0.0021)}}
    return {"name": name, "class": [name, *twins], "probability": probability, "parameters": size, "share": share}


def rival(name: str, probability: float, instead_of: str) -> dict:
    return {"name": name, "class": [name], "probability": probability, "cosine": 0.9, "instead_of": instead_of}


@pytest.fixture
def diagnosis():
    """Make a diagnosis of two effects, one with an open rival and one with a twin; `changes` by key."""

    def make(**changes) -> Diagnosis:
        by_joint = {"joint1": 3e-3, "joint2": 4e-3}
        told = {
            "verdict": "partly_explained",
            "sentence": "Partly explained.",
            "gap": {
                "floor_rad": dict.fromkeys(by_joint, 1e-4),
                "before_rad": by_joint,
                "after_rad": dict.fromkeys(by_joint, 1e-3),
                "before_Nm": dict.fromkeys(by_joint, 1e-3),
                "explained_share": 1 - LEFT,
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
            "advice": [TELLING, TWINS],
            "ratios": {},
            "ratio_covariance": [],
            "chi2_per_dof": 2.0,
            "segments": 60,
            "scale_b": 0.004,
            "model_effects": {},
            "assumptions": [],
            "seconds": 1.0,
        }
        return Diagnosis.model_validate(told | changes)

    return make


def test_the_probabilities_of_each_place_add_up(diagnosis):
    rows = gap_tables.standing_rows(diagnosis())

    places = [i for i, row in enumerate(rows) if row[0]]
    assert [rows[i][0] for i in places] == [DRY, TILT]
    for first, last in zip(places, [*places[1:], len(rows)], strict=True):
        stated = [0.0 if "<" in row[2] else float(row[2].rstrip("%")) for row in rows[first:last]]
        assert sum(stated) == pytest.approx(100, abs=0.5)


def test_each_rival_says_what_splits_it_or_would(diagnosis):
    split = {row[1]: row[4] for row in gap_tables.standing_rows(diagnosis())}

    assert split["Stribeck friction, joint 1 [stribeck_joint1]"] == "next step 1"
    assert split[f"{TILT} or encoder offset, joint 1 [encoder_offset_joint1]"] == "next step 2"
    assert split["Coulomb friction, joint 2 [coulomb_joint2]"] == "these recordings"
    assert split["a cause outside the library"] == "10.0% of the excess is left"
    assert not any("spring_joint1" in rival for rival in split)


def test_next_steps_are_numbered_as_the_rivals_say_and_end_with_what_has_no_name(diagnosis):
    steps = gap_tables.next_steps(diagnosis())

    assert steps[:2] == [in_words(TELLING), in_words(TWINS)]
    assert "another cause" in steps[2]
    assert gap_tables.next_steps(diagnosis(verdict="named", advice=[])) == ["Nothing is left to be decided."]


def test_an_effect_whose_name_begins_another_is_no_match(diagnosis):
    rows = gap_tables.standing_rows(diagnosis(advice=[TELLING.replace("stribeck_joint1", "stribeck_joint12")]))

    assert {row[4] for row in rows if "[stribeck_joint1]" in row[1]} == {"these recordings"}


def test_steps_end_at_the_share_of_the_sentence(diagnosis):
    assert gap_tables.step_rows(diagnosis()) == [
        ("bare model", "5.00", "0.0%"),
        (f"+ {DRY}", "2.50", "75.0%"),
        (f"+ {TILT}", "1.60", "90.0%"),
    ]


def test_without_a_name_the_closest_effect_has_a_place(diagnosis):
    closest = rival("coulomb_joint1", 0.3, "")
    rows = gap_tables.standing_rows(diagnosis(verdict="unexplained", effects=[], rivals=[closest]))

    assert [row[:3] for row in rows] == [
        (DRY, DRY, "30%"),
        ("", "another rival, or no effect", "50%"),
        ("", "a cause outside the library", "20%"),
    ]


def test_nothing_closes_where_the_model_stays_bare(diagnosis):
    found = diagnosis()
    bare = found.model_copy(update={"gap": found.gap.model_copy(update={"waterfall": []})})

    assert gap_tables.closed_sentence(bare) == ""
    assert "70.0% of the gap" in gap_tables.closed_sentence(found)


@pytest.mark.parametrize("verdict", ["no_gap", "named", "partly_explained", "unexplained"])
def test_the_page_says_verdict_first_and_whole(diagnosis, tmp_path, verdict):
    found = diagnosis(verdict=verdict)

    page = write_gap_report(found, "A & B", tmp_path, save_gap_figures(found, tmp_path)).read_text(encoding="utf-8")

    assert page.index("A &amp; B") < page.index("Partly explained.") < page.index("Which effects")
    assert page.count("<img") == 3
    assert "$" not in page


def test_a_fault_that_comes_again_and_again_is_one_line(diagnosis):
    def found(name: str, at: float) -> dict:
        return {"name": name, "run": "first", "axis": "joint1", "at_s": at, "evidence": "It is off."}

    few, many = [found("repeated_sample", 0.1 * i) for i in range(3)], [found("outlier", 1.0 + i) for i in range(40)]
    rows = gap_tables.finding_rows(diagnosis(sensor_findings=[*few, *many]))
    assert [row[3:] for row in rows[:3]] == [("0.000", "It is off."), ("0.100", "It is off."), ("0.200", "It is off.")]
    assert [row[3:] for row in rows[3:]] == [("1.000", "It is off; 40 times, first here")]


def test_knots_that_no_recording_reaches_are_not_drawn(diagnosis):
    place = {"site": "encoder1", "coordinate": "angle", "share": 0.5, "sentence": "There.", "unit": "rad"}
    knots = {"knots": [-1.0, 0.0, 1.0], "values": [0.0, 0.01, 0.02], "std": [1.7e305, 1e-3, 2e-3]}

    (axes,) = [axes for axes in where_figure(diagnosis(where=[place | knots])).axes if axes.get_visible()]

    np.testing.assert_allclose(axes.lines[0].get_ydata(), [np.nan, 10, 20])
    assert axes.get_ylim()[1] < 50


def test_an_improbable_alternative_of_the_same_shape_has_a_reason(diagnosis) -> None:
    alternatives = [
        rival("friction_curve_joint1", 1e-6, "coulomb_joint1") | {"cosine": 1.0},
        rival("hysteresis_joint1", 1e-6, "coulomb_joint1") | {"cosine": 0.9},
    ]
    rows = {row[1]: row[-1] for row in gap_tables.standing_rows(diagnosis(rivals=alternatives))}
    reasons = [reason for name, reason in rows.items() if "friction_curve_joint1" in name]
    assert "a more general form; not needed" in reasons[0]
    assert [reason for name, reason in rows.items() if "hysteresis_joint1" in name] == [gap_tables.SPLIT]
