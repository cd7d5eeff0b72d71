"""Names of columns that state a scaled unit, are empty, contain commas, or have another form than the numbers."""

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.tables.options import typed_options
from dpr_lab.storage.tables.plausible import gaps
from dpr_lab.storage.tables.understand import understand
from tests.storage.swing_files import RIG, THETA1, THETA2, T, is_the_swing

DEGREES = np.rad2deg(np.array([THETA1, THETA2]))


def file_of(folder, head, form, inner=THETA1, outer=THETA2):
    rows = (form.format(t=t, a=a, b=b) for t, a, b in zip(T, inner, outer, strict=True))
    (folder / "a.txt").write_text(head + "".join(rows), encoding="utf-8")
    return folder / "a.txt"


@pytest.mark.parametrize(
    ("inner", "outer", "unit", "scale"),
    [
        ("theta1 [rev]", "theta2 [rev]", "deg", 360.0),
        ("theta1_e3", "theta2_e3", None, 1e-3),
        ("theta1_x1000", "theta2_x1000", None, 1e-3),
        ("theta1_rad_e-3", "theta2_rad_e-3", None, 1e-3),
        ("theta1_mrad", "theta2_mrad", None, 1e-3),
        ("theta1_urad", "theta2_urad", None, 1e-6),
        ("theta1_mdeg", "theta2_mdeg", "deg", 1e-3),
        ("theta1_ddeg", "theta2_ddeg", "deg", 0.1),
        ("theta1 (0.1 deg)", "theta2 (0.1 deg)", "deg", 0.1),
        ("theta1_arcmin", "theta2_arcmin", "deg", 1 / 60),
        ("gon1", "gon2", "deg", 0.9),
    ],
)
def test_the_scale_of_two_rods_is_requested_at_once(tmp_path, inner, outer, unit, scale):
    factor = 1 / scale if unit is None else 180 / np.pi / scale
    file = file_of(tmp_path, f"t,{inner},{outer}\n", "{t:.3f},{a:.12g},{b:.12g}\n", factor * THETA1, factor * THETA2)
    with pytest.raises(RunError, match=rf"by its name: convert it .*--scale {scale:.9g}\)"):
        import_csv(file, RIG)
    options = ImportOptions(unit=unit, scale={"theta1": scale, "theta2": scale})
    assert is_the_swing(import_csv(file, RIG, options), 1e-8)


def test_a_scaled_column_next_to_an_angle_is_not_used(tmp_path):
    file = file_of(tmp_path, "t,theta1_e3,theta1,theta2\n", "{t:.3f},5,{a:.12g},{b:.12g}\n")
    assert is_the_swing(import_csv(file, RIG))


@pytest.mark.parametrize("head", ["theta1 (counts 4096/rev),theta2 (counts 4096/rev)", "rev_counts1,rev_counts2"])
def test_counts_whose_name_states_the_revolution_are_not_scaled(tmp_path, head):
    counts = np.round(RIG.positions(np.column_stack([0 * T, THETA1, THETA2]))).astype(int)
    file = file_of(tmp_path, f"t,{head}\n", "{t:.3f},{a},{b}\n", counts[:, 1], counts[:, 2])
    columns: dict[str, str] = dict(zip(("theta1", "theta2"), head.split(","), strict=True))
    assert (import_csv(file, RIG, ImportOptions(columns=columns, unit="counts")).counts == counts).all()


def test_grad_requires_a_decision_between_degrees_and_gon(tmp_path):
    file = file_of(tmp_path, "t,theta1 (grad),theta2 (grad)\n", "{t:.3f},{a:.12g},{b:.12g}\n", *DEGREES)
    with pytest.raises(RunError, match=r"can mean degrees or gon .*--unit deg; for gon, .*--scale 0.9"):
        import_csv(file, RIG)
    assert is_the_swing(import_csv(file, RIG, ImportOptions(unit="deg")))
    gon = ImportOptions(unit="deg", scale={"theta1": 0.9, "theta2": 0.9})
    assert import_csv(file, RIG, gon).theta[0, 1] == pytest.approx(0.9 * THETA1[0])


@pytest.mark.parametrize(
    ("head", "form"),
    [
        ("Time [s]   Angle 1 [deg]   Angle 2 [deg]\n", "{t:.3f}\t{a:.12g}\t{b:.12g}\n"),
        ("Time [s]   inner angle (deg)   outer angle (deg)\n", "{t:.3f}\t{a:.12g}\t{b:.12g}\n"),
        ("| t | theta1_deg | theta2_deg |\n|---|---|---|\n", "| {t:.3f} | {a:.12g} | {b:.12g} |\n"),
        ("", "{t:.3f} theta1_deg={a:.12g} theta2_deg={b:.12g}\n"),
        ("start\n", "[{t:.3f}] theta1_deg:{a:.12g} theta2_deg:{b:.12g}\n"),
        ("clock,inner,outer\n", "14:05:0{t:.3f},{a:.12g}°,{b:.12g}°\n"),
        ("t,inner,outer\n", "{t:.3f},{a:.12g} deg,{b:.12g} deg\n"),
    ],
)
def test_names_in_other_forms_are_found(tmp_path, head, form):
    assert is_the_swing(import_csv(file_of(tmp_path, head, form, *DEGREES), RIG))


def test_a_table_of_words_is_refused_with_the_forms_that_are_read(tmp_path):
    (tmp_path / "a.txt").write_text("one two\nthree four\n")
    with pytest.raises(RunError, match=r"no row of numbers: a table is read from .*bars \(\|\)"):
        import_csv(tmp_path / "a.txt", RIG)


@pytest.mark.parametrize(
    ("head", "first", "sentence"),
    [
        ("t,a,b\n", "{t},{a},{b},go\n", "line 2 has 4 fields, but there are 3 columns"),
        ("", "{t},{a},{b},go\n", "line 25 has 3 fields, but there are 4 columns"),
        ("t,a,b\n", "note,{t}\n", "the header has 3 names .* but line 2 has 2 fields"),
        ("t,a,b\n", "12:00:00.{t},{a}\n", "the header has 3 names .* but line 2 has 2 fields"),
        ("t,a,b\n", "0 s,1 deg\n", "the header has 3 names .* but line 2 has 2 fields"),
    ],
)
def test_rows_of_another_length_below_the_names_are_not_settings(tmp_path, head, first, sentence):
    file = file_of(tmp_path, head + 24 * first.format(t=0, a=1, b=2), "{t},{a},{b}\n")
    with pytest.raises(RunError, match=sentence):
        import_csv(file, RIG)


@pytest.mark.parametrize("first", ["0,1,2,go", "12:00:00.5,1", "0 s,1 deg"])
def test_a_row_of_another_length_above_the_names_that_begins_with_a_value_is_no_setting(tmp_path, first):
    with pytest.raises(RunError, match="line 2 has 3 fields, but there are"):
        import_csv(file_of(tmp_path, f"{first}\nt,theta1,theta2\n", "{t},{a},{b}\n"), RIG)


def test_a_header_of_one_name_has_one_column(tmp_path):
    with pytest.raises(RunError, match="has 3 fields, but there is 1 column: add the missing names"):
        import_csv(file_of(tmp_path, "swing\n", "{t},{a},{b}\n"), RIG)


def test_a_column_without_a_name_is_shown_and_selected_by_its_number(tmp_path, one):
    file = file_of(tmp_path, "time,,speed\n", "{t:.3f},{a:.12g},{b:.12g}\n")
    shown = understand(file, one, ImportOptions())
    assert shown.facts()["columns"] == "t = time, theta1 = column 2 (without a name)"
    assert any("theta1: column 2 (without a name), because no other column" in note for note in shown.notes)
    np.testing.assert_allclose(import_csv(file, one, ImportOptions(columns={"theta1": "3"})).theta[:, 1], THETA2)


def test_a_name_with_a_comma_is_quoted_and_given_by_its_number(tmp_path):
    file = file_of(tmp_path, '"Elapsed, s",A,B\n', "{t},{a:.12g},{b:.12g}\n")
    with pytest.raises(RunError, match=r"has: 'Elapsed, s', A, B.*NAME can be the number of the column"):
        import_csv(file, RIG)
    columns = next(option for option in typed_options() if option.name == "columns")
    with pytest.raises(ValueError, match="whose name has a comma is given by its number"):
        columns.read("t=Elapsed, s,theta1=A")
    numbers = ImportOptions(columns=columns.read("t=1,theta1=2,theta2=B"))
    assert is_the_swing(import_csv(file, RIG, numbers))


def test_one_of_several_columns_with_the_same_name_is_given_by_its_number(tmp_path):
    file = file_of(tmp_path, "time,q,time,q,q\n", "{t:.3f},{a:.12g},7,1,{b:.12g}\n")
    with pytest.raises(RunError, match=r"no single column found for .*NAME can be the number of the column"):
        import_csv(file, RIG)
    with pytest.raises(RunError, match=r"2 columns are named 'time' .*; NAME can be the number of the column"):
        import_csv(file, RIG, ImportOptions(columns={"t": "time"}))
    numbers = ImportOptions(columns={"t": "1", "theta1": "2", "theta2": "5"})
    assert is_the_swing(import_csv(file, RIG, numbers))


def test_empty_columns_without_a_name_are_not_listed(tmp_path):
    with pytest.raises(RunError, match=r"the table has: t, theta1\. Name it"):
        import_csv(file_of(tmp_path, "t,theta1,,\n", "{t:.3f},{a:.12g},,\n"), RIG)


def test_a_number_that_is_a_name_is_the_name(tmp_path):
    file = file_of(tmp_path, "t,x,outermost,1\n", "{t:.3f},5,{b:.12g},{a:.12g}\n")
    assert is_the_swing(import_csv(file, RIG, ImportOptions(columns={"theta1": "1", "theta2": "3"})))


def test_one_row_per_sensor_and_columns_of_sin_and_cos_are_explained(tmp_path, one):
    form = "{t:.3f},joint1,{a:.12g}\n{t:.3f},joint2,{b:.12g}\n"
    for rig in (one, RIG):
        with pytest.raises(RunError, match=r"one row per sensor .*: export one column per joint"):
            import_csv(file_of(tmp_path, "timestamp,sensor,value\n", form), rig)
    with pytest.raises(RunError, match=r"export the angle, atan2\(sin, cos\)"):
        import_csv(file_of(tmp_path, "t,cos1,sin1\n", "{t:.3f},{a:.6f},{b:.6f}\n"), RIG)


def test_a_relative_reference_is_not_contradicted(tmp_path):
    """The note on the encoder of joint 2 is absent if a warning proposes relative angles."""
    from tests.storage.test_csv_import import THETA1, THETA2, T

    rows = np.column_stack([T, THETA1, THETA2 - THETA1])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="t,theta1,theta2", comments="")
    shown = understand(tmp_path / "a.csv", RIG, ImportOptions())
    assert "--angles" in shown.mend
    assert not any("theta2 is absolute" in note for note in shown.notes)


def test_one_gap_is_not_plural(tmp_path, one):
    file = file_of(tmp_path, "t,theta1,x\n", "{t:.3f},{a:.12g},{b}\n")
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:80], *lines[120:]]))
    assert understand(file, one, ImportOptions()).facts()["rate"].endswith("; 1 interruption")


@pytest.mark.parametrize(
    ("comment", "columns"),
    [
        ("Recorded by Anna", {}),
        ("time theta2 theta1", {"theta1": "theta2", "theta2": "theta1"}),
    ],
)
def test_an_empty_comment_does_not_make_names_of_prose_above_it(tmp_path, comment, columns):
    file = file_of(tmp_path, f"# {comment}\n#\n", "{t:.3f} {a:.12g} {b:.12g}\n")
    assert is_the_swing(import_csv(file, RIG, ImportOptions(columns=columns)))


@pytest.mark.parametrize(
    ("head", "form", "used", "other"),
    [
        ("time_s,t", "{t:.3f},9{t:.6f}", "time_s", "t"),  # both have all digits, so the stated unit decides
        ("t,clock_s", "{t:.3f},{t:.0f}", "t", "clock_s"),  # whole seconds are not used
        ("time_ms,time_s", "{t:.3f}e3,{t:.1f}", "time_ms", "time_s"),
        ("t,s", "{t:.3f},{a}", "t", ""),  # a column that decreases is no time
    ],
)
def test_of_two_times_the_more_precise_or_the_one_with_a_unit_is_used_with_a_note(tmp_path, head, form, used, other):
    run = import_csv(file_of(tmp_path, f"{head},theta1,theta2\n", form + ",{a:.12g},{b:.12g}\n"), RIG)
    assert is_the_swing(run)
    expected = [f"time: {used}; {other} can also be the time (--columns t=NAME uses it)"] if other else []
    assert [note for note in run.notes if "can also be the time" in note] == expected


def test_a_stated_time_or_rate_needs_no_note_on_other_times(tmp_path):
    file = file_of(tmp_path, "time,elapsed,theta1,theta2\n", "{t:.3f},{t:.3f},{a:.12g},{b:.12g}\n")
    for options in (ImportOptions(rate_hz=200.0), ImportOptions(columns={"t": "elapsed"})):
        run = import_csv(file, RIG, options)
        assert is_the_swing(run)
        assert not any("can also be the time" in note for note in run.notes)


def test_a_stated_unit_of_time_selects_the_column_of_this_unit(tmp_path):
    file = file_of(tmp_path, "time_us,time_ms,theta1,theta2\n", "{t:.3f}e6,{t:.2f}e3,{a:.12g},{b:.12g}\n")
    assert import_csv(file, RIG, ImportOptions(time_unit="us")).t[-1] == pytest.approx(T[-1])
    assert import_csv(file, RIG, ImportOptions(time_unit="ms")).t[-1] == pytest.approx(round(T[-1], 2), abs=0.01)


@pytest.mark.parametrize("head", ["time,t", "time,time_s,elapsed_s"])
def test_times_of_which_none_is_preferable_are_all_named(tmp_path, head):
    form = ",".join(["{t:.3f}"] * len(head.split(","))) + ",{a:.12g},{b:.12g}\n"
    file = file_of(tmp_path, f"{head},theta1,theta2\n", form)
    named = head.replace(",", ", ")
    with pytest.raises(RunError, match=f"Name it: --columns t=NAME; .*{named} can each be the time"):
        import_csv(file, RIG)
    assert is_the_swing(import_csv(file, RIG, ImportOptions(columns={"t": "time"})))


def test_the_rounding_of_times_makes_no_gap():
    t = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(1.005, 2.0, 0.01)])
    assert [len(gaps(t + shift)) for shift in np.linspace(0.0, 9.0, 91)] == 91 * [0]
