"""Tables in many forms give the same run; a table that cannot be interpreted is refused with the place."""

import json
import re

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.errors import RunError
from dpr_lab.rig import load_rig
from dpr_lab.rig_tables import Rods
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.export import export
from dpr_lab.storage.inspect import info, verify
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.tables.columns import guess_columns

RIG = load_rig("paper")
T = np.round(np.arange(200) * 0.005, 6)
THETA1, THETA2, *_ = simulate(base_parameters(RIG.nominal, RIG.L1, RIG.g), RIG.L1, RIG.g, [np.pi, 0.1, 0, 0], T).T


def table(path, names, *columns, delimiter=",", lines=()):
    rows = [delimiter.join(f"{value:.12g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([*lines, delimiter.join(names), *rows]) + "\n", encoding="utf-8")
    return path


def read(path, **options):
    return import_csv(path, RIG, ImportOptions(**options))


def assert_the_swing(run, atol=1e-9):
    np.testing.assert_allclose(run.t, T, atol=1e-12)
    np.testing.assert_allclose(run.theta, np.column_stack([0 * T, THETA1, THETA2]), atol=atol)


@pytest.mark.parametrize("unit", ["rad", "deg"])
@pytest.mark.parametrize("zero", ["upright", "hanging"])
@pytest.mark.parametrize("angles", ["absolute", "relative"])
def test_conventions_are_equivalent(tmp_path, unit, zero, angles):
    shift = np.pi if zero == "hanging" else 0.0
    second = THETA2 - THETA1 if angles == "relative" else THETA2 - shift
    scale = 180 / np.pi if unit == "deg" else 1.0
    file = table(
        tmp_path / "a.csv", ("t_s", f"theta1_{unit}", f"theta2_{unit}"), T, (THETA1 - shift) * scale, second * scale
    )
    assert_the_swing(read(file, unit=unit, zero=zero, angles=angles))


def test_counts_are_read_by_the_rig_and_kept(tmp_path):
    counts = np.round(RIG.positions(np.column_stack([0 * T, THETA1, THETA2]))).astype(int)
    file = table(tmp_path / "a.csv", ("time", "counts1", "counts2"), T, counts[:, 1], counts[:, 2])
    for run in (read(file, unit="counts"), import_csv(file, RIG, ImportOptions(unit="counts"), tmp_path / "a.mcap")):
        assert_the_swing(run, atol=2 * np.pi / 16384)
        np.testing.assert_array_equal(run.counts, counts)
    broken = table(tmp_path / "b.csv", ("time", "counts1", "counts2"), T, THETA1, THETA2)
    with pytest.raises(RunError, match="counts requires integers"):
        read(broken, unit="counts")


@pytest.mark.parametrize(
    ("names", "delimiter", "lines"),
    [
        (("t", "theta1", "theta2"), ",", ()),
        (("Time (s)", "Theta_1 [rad]", "Theta_2 [rad]"), ";", ("# bench 3", "", "// second remark")),
        (("seconds", "q1", "q2"), "\t", ("% made by a logger",)),
        (("time_s", "θ1", "θ2"), ",", ("Logger 2.1",)),
        (("timestamp", "phi1", "phi2"), " ", ()),
        (("\ufefft_s", '"th1"', '"th2"'), ",", ()),
    ],
)
def test_headers_delimiters_and_comments_are_found(tmp_path, names, delimiter, lines):
    assert_the_swing(read(table(tmp_path / "a.csv", names, T, THETA1, THETA2, delimiter=delimiter, lines=lines)))


def test_decimal_commas_go_with_semicolons(tmp_path):
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T, THETA1, THETA2, delimiter=";")
    file.write_text(file.read_text().replace(".", ","))
    assert_the_swing(read(file))


def test_a_row_of_units_and_windows_line_ends_are_accepted(tmp_path):
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T, THETA1, THETA2)
    head, rest = file.read_text().split("\n", 1)
    file.write_bytes("\r\n".join([head, "s,rad,rad", *rest.split("\n")]).encode())
    assert_the_swing(read(file))


def test_a_header_in_a_comment_and_columns_by_number(tmp_path):
    rows = np.column_stack([T, THETA1, THETA2])
    np.savetxt(tmp_path / "a.txt", rows, header="t theta1 theta2")
    assert_the_swing(read(tmp_path / "a.txt"))
    np.savetxt(tmp_path / "b.txt", rows[:, [1, 0, 2]], delimiter=",")
    with pytest.raises(RunError, match="the table has: 1, 2, 3"):
        read(tmp_path / "b.txt")
    assert_the_swing(read(tmp_path / "b.txt", columns={"t": "2", "theta1": "1", "theta2": "3"}))


@pytest.mark.parametrize(
    "stamp", ["01-03-2026 14:30:{:06,3f}", "14:30:{:06,3f}", "30:{:06,3f}", "2026-03-01T14:30:{:06,3f}+01:00"]
)
def test_times_of_day_are_seconds(tmp_path, stamp):
    stamps = [stamp.replace("{:06,3f}", f"{t:06.3f}".replace(".", ",")) for t in T]
    rows = [f"{stamp};{a:.12g};{b:.12g}".replace(".", ",") for stamp, a, b in zip(stamps, THETA1, THETA2, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["Zeit;theta1;theta2", *rows]), encoding="utf-8")
    assert_the_swing(read(tmp_path / "a.csv"))


def test_common_names_of_angles_of_encoders_arm_and_a_single_rod(tmp_path):
    assert guess_columns(["Zeit", "enc1_deg", "enc2_deg"], "deg") == {
        "t": "Zeit",
        "theta1": "enc1_deg",
        "theta2": "enc2_deg",
    }
    assert guess_columns(["time", "arm_angle", "theta1"])["theta0"] == "arm_angle"
    for unit, names in {"deg": ["Shoulder (deg)", "Elbow (deg)"], "counts": ["inner rod", "outer rod counts"]}.items():
        assert guess_columns(["Time", *names], unit) == dict(
            zip(("t", "theta1", "theta2"), ["Time", *names], strict=True)
        )
    assert guess_columns(["t", "shoulder", "theta1", "theta2"])["theta1"] == "theta1"
    measured = guess_columns(["time", "pos_meas1", "pos_meas2", "q1_measured", "vel_meas1", "pos_des1"])
    assert measured == {"t": "time", "theta2": "pos_meas2"}  # two columns of theta1
    assert guess_columns(["q1", "q1_actual", "q2_actual"]) == {"theta1": "q1", "theta2": "q2_actual"}
    film = guess_columns(["time_s", "theta1_exp", "theta2_exp", "theta1_sim", "theta2_sim"])
    assert film == {"t": "time_s", "theta1": "theta1_exp", "theta2": "theta2_exp"}
    pendubot = guess_columns(["t", "U", "Us or Alpha1_r", "Alpha1", "dAlpha1", "Alpha2", "dAlpha2"])
    assert pendubot == {"t": "t", "theta1": "Alpha1", "theta2": "Alpha2"}
    assert guess_columns(["t", "enc1", "enc2", "alpha1", "alpha2"]) == {"t": "t"}
    assert guess_columns(["t", "q1", "q2", "alpha1", "alpha2"]) == {"t": "t", "theta1": "q1", "theta2": "q2"}
    rows = np.column_stack([T, THETA1 - np.pi])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="time,rod_angle", comments="")
    rod = RIG.model_copy(update={"rods": Rods(mounted="inner")})
    assert import_csv(tmp_path / "a.csv", rod, ImportOptions(zero="hanging")).mounting == "inner"


def test_a_unit_of_time_that_contradicts_its_name_is_refused(tmp_path):
    file = table(tmp_path / "a.csv", ("time_ms", "theta1", "theta2"), T * 1000, THETA1, THETA2)
    assert_the_swing(read(file, time_unit="ms"))
    with pytest.raises(RunError, match="'time_ms' is in ms by its name: remove --time-unit"):
        read(file, time_unit="s")
    with pytest.raises(RunError, match="states ms, but the given unit is s"):
        read(file, columns={"t": "time_ms"}, time_unit="s")
    assert_the_swing(read(file))


def test_degrees_taken_for_radians_are_noticed(tmp_path):
    file = table(tmp_path / "a.csv", ("t", "theta1 [°]", "theta2_deg"), T, THETA1, THETA2)
    with pytest.raises(RunError, match=r"states °, but the given unit is rad"):
        read(file, columns={"theta1": "theta1 [°]"}, unit="rad")


def test_a_table_of_hanging_zero_taken_for_upright_is_noticed(tmp_path):
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T, THETA1 - np.pi, THETA2 - np.pi)
    assert "(--zero hanging)" in read(file).notes[-1]
    assert "hanging" not in " ".join(read(file, zero="hanging").notes)


@pytest.mark.slow
def test_wrapped_angles_are_unwrapped_and_reported(tmp_path):
    theta2 = np.pi + 9 * T * 4
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T, THETA1, (theta2 + np.pi) % (2 * np.pi) - np.pi)
    run = read(file)
    np.testing.assert_allclose(np.diff(run.theta[:, 2]), np.diff(theta2), atol=1e-9)
    assert run.notes[0] == "theta2: the logger wrapped this angle; the import unwrapped it"


@pytest.mark.slow
def test_uneven_times_doubled_rows_gaps_and_nan_survive_to_the_file(tmp_path):
    t = np.cumsum(np.random.default_rng(0).uniform(0.004, 0.0055, 200)) + 1234.5
    t[150:] += 0.5
    t[20] = t[19]
    theta1 = THETA1.copy()
    theta1[77] = np.nan
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), t, theta1, THETA2)
    kept = np.delete(np.arange(200), [20, 77])
    run = import_csv(file, RIG, out=tmp_path / "a.mcap")
    expected = np.array([float(f"{value:.12g}") for value in t])[kept]
    np.testing.assert_allclose(run.t, expected - expected[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.theta[:, 1], THETA1[kept], atol=1e-9)
    assert any(note == "rows without a value (NaN), treated as missing: 1" for note in run.notes)
    assert any(note == "rows with the same time as the previous row, removed: 1" for note in run.notes)
    assert any(note.startswith("interruptions kept: ") and "the longest 0.50" in note for note in run.notes)
    assert verify(tmp_path / "a.mcap").ok
    extra = info(tmp_path / "a.mcap").extra
    assert float(extra["t_offset_s"]) == pytest.approx(t[0])
    assert json.loads(extra["columns"]) == {"t": "t", "theta1": "theta1", "theta2": "theta2"}


def test_the_run_file_of_an_import_is_the_import(tmp_path):
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T + 7, THETA1 + 2 * np.pi, THETA2)
    options = ImportOptions(pose="X1", note="by hand")
    run, stored = import_csv(file, RIG, options), import_csv(file, RIG, options, tmp_path / "a.mcap")
    np.testing.assert_array_equal(run.t, stored.t)
    np.testing.assert_array_equal(run.theta, stored.theta)
    assert (run.notes, run.rate_hz, run.pose) == (stored.notes, stored.rate_hz, stored.pose)
    assert stored.counts is None
    assert run.theta[0, 1] == pytest.approx(THETA1[0], abs=1e-9)
    assert len(stored.rest) == 0
    assert load_run(tmp_path / "a.mcap", RIG).complete


def test_a_slice_starts_at_zero(tmp_path):
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T + 100, THETA1, THETA2)
    run = read(file, start_s=0.2, duration_s=0.3)
    assert len(run.t) == pytest.approx(60, abs=1)
    assert run.t[0] == 0
    assert run.theta[0, 1] == pytest.approx(THETA1[40], abs=1e-9)
    with pytest.raises(RunError, match=r"no rows after 105 s; the table ends at 100.995 s"):
        read(file, start_s=5)


def test_our_own_export_is_read_back_without_options(tmp_path):
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T, THETA1, THETA2)
    run = read(file)
    again = read(export(run, tmp_path / "b.csv"))
    np.testing.assert_array_equal(again.theta, run.theta)
    np.testing.assert_array_equal(again.t, run.t)


def test_a_column_of_words_and_an_empty_first_row_are_accepted(tmp_path):
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T, THETA1, THETA2)
    head, rest = file.read_text().split("\n", 1)
    rows = [row + ',"swing, free"' for row in rest.split()]
    file.write_text("\n".join([head + ",state", "-0.005,,,held", *rows]))
    run = read(file)
    assert_the_swing(run)
    assert run.notes[:-1] == ("rows without a value (NaN), treated as missing: 1",)


def test_an_incomplete_last_row_is_left_out_and_reported(tmp_path):
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T, THETA1, THETA2)
    file.write_text(file.read_text() + "1.0,3.1")
    run = read(file)
    assert_the_swing(run)
    assert run.notes[:-1] == ("the last line, 202, is incomplete and was ignored",)
    assert 'write joint2 = "absolute"' in run.notes[-1]  # the encoder of the rig file is relative


HEAD = "t,theta1,theta2\n"


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is empty; check the path, or write the table again"),
        (b" \n\n", "is empty"),
        (b"# only a remark\n", "contains no rows"),
        (HEAD.encode(), "no row of numbers"),
        (b"dear diary,\ntoday it swung\n", "no row of numbers"),
        (bytes(range(256)) * 9, "binary file"),
        (b"t,theta1\n0,\x00\n", "binary file"),
        (f"{HEAD}0,1,2\n".encode(), "only 1 row remains"),
        (f"{HEAD}0,1,2\n0,1,2\n".encode(), "only 1 row remains"),
        (f"{HEAD}0,1,2\n1,1,2\n0.5,1,2\n2,1,2\n".encode(), "line 4: time decreases by 0.5 s, to 0.5 s: split"),
        (f"{HEAD}0,1,2\n1,1\n2,1,2\n".encode(), "line 3 has 2 fields, but there are 3 columns"),
        (
            b"t,theta1\n0,1.5,2.5\n1,1.5,2.5\n",
            "has 3 fields, but there are 2 columns: add the missing names to the header",
        ),
        (
            b"Times (s),Angle (rad)\n0,1.5,2.5\n1,1.5,2.5\n",  # the names contain the blanks
            "has 3 fields, but there are 2 columns: add the missing names to the header",
        ),
        (f"{HEAD}0,1,2\n1,one,2\n2,1,2\n".encode(), "line 3: 'one' in column 'theta1' is not a number"),
        (f"{HEAD}0,nan,2\n1,nan,2\n2,1,2\n".encode(), "2 of 3 rows have no value"),
        (f"{HEAD}0,1,2\n{'5' * 70},1,2\n".encode(), "rows are 5.55556e+69 s apart"),
        (f"{HEAD}0,1,2\n1,1,2\n2,1,2\n1{'0' * 12},1,2\n".encode(), "the table lasts 1e+12 s"),
        (f"{HEAD}nan,1,2\nnan,1,2\n".encode(), "the time column contains no number"),
        (
            b"t_s,theta1_rad,omega1\n0,1,2\n1,1,2\n",
            "no single column found for theta2; the table has: t_s, theta1_rad, omega1",
        ),
        (b"theta1,theta2\n0,1\n1,1\n", "no single column found for t;"),
        (b"t,theta1,q1,theta2\n0,1,1,1\n1,1,1,1\n", "no single column found for theta1"),
    ],
)
def test_bad_tables_are_refused_in_a_sentence(tmp_path, content, sentence):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(RunError) as caught:
        import_csv(tmp_path / "a.csv", RIG, out=tmp_path / "a.mcap")
    assert sentence in str(caught.value)
    assert "a.csv" in str(caught.value)
    assert not (tmp_path / "a.mcap").exists()


@pytest.mark.parametrize(
    ("row", "decimal_commas"),
    [("1,5,2,3", True), ("01.02.2024 12:00,5,2,3", True), ("1,1.5,2,3", False), ("1,1.5e-02,2,3", False)],
)
def test_fields_with_points_are_not_split_decimal_commas(tmp_path, row, decimal_commas):
    (tmp_path / "a.csv").write_text(f"{HEAD}0,1,2\n{row}\n2,1,2\n")
    with pytest.raises(RunError, match="line 3 has 4 fields, but there are 3 columns") as caught:
        read(tmp_path / "a.csv")
    assert ("if commas are decimal signs" in str(caught.value)) == decimal_commas


def test_a_column_that_is_named_for_a_rod_is_not_also_taken_for_the_arm(tmp_path):
    file = table(tmp_path / "a.csv", ("Time [s]", "Arm angle (rad)", "Tip angle (rad)"), T, THETA1, THETA2)
    with pytest.raises(RunError, match="Name them: --columns theta1=NAME,theta2=NAME"):
        read(file)
    assert_the_swing(read(file, columns={"theta1": "Arm angle (rad)", "theta2": "Tip angle (rad)"}))


def test_the_message_on_unknown_columns_lists_the_columns_of_the_table(tmp_path):
    file = table(tmp_path / "a.csv", ("t", "angle a", "angle b"), T, THETA1, THETA2)
    with pytest.raises(RunError, match=r"has: t, angle a, angle b\. Name them: --columns theta1=NAME,theta2=NAME"):
        read(file)
    assert_the_swing(read(file, columns={"theta1": "angle a", "theta2": "angle b"}))
    more = table(tmp_path / "b.csv", ("t", "u", "v", "w"), T, THETA1, THETA2, THETA2)
    with pytest.raises(RunError, match=r"has: t, u, v, w\. Name them: --columns theta1=NAME,theta2=NAME"):
        read(more)


@pytest.mark.parametrize(("name", "sentence"), [("a.mp4", "track the pivot"), ("a.png", "is a picture")])
def test_videos_and_pictures_are_refused_with_the_step_before_the_import(tmp_path, name, sentence):
    (tmp_path / name).write_bytes(bytes(range(256)))
    with pytest.raises(RunError, match=sentence):
        read(tmp_path / name)


def test_missing_files_columns_and_poses_are_named(tmp_path):
    with pytest.raises(RunError, match=r"no.csv: cannot be read: No such file or directory; check its path"):
        read(tmp_path / "no.csv")
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T, THETA1, THETA2)
    with pytest.raises(RunError, match=r"no columns are named 'angle' \(--columns theta1=angle\)"):
        read(file, columns={"theta1": "angle"})
    with pytest.raises(RunError, match=r"no rows after 20 s; the table ends at 0.995 s"):
        read(file, start_s=20.0)
    with pytest.raises(RunError, match="the rig has no pose 'X9'; its poses: X1, X2, X3"):
        read(file, pose="X9")
    with pytest.raises(ValueError, match="not for omega1"):
        ImportOptions(columns={"omega1": "w"})


@pytest.mark.parametrize("wild", [12.0, 100.0, 1e6, 1e308, -1e308, -40.0])
@pytest.mark.parametrize("rows", [(0,), (57,), (57, 58), (199,), (20, 90, 150)])
def test_an_outlier_is_left_out_and_not_replaced(tmp_path, wild, rows):
    theta2 = THETA2.copy()
    theta2[list(rows)] = wild
    run = read(table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T, THETA1, theta2))
    kept = np.delete(np.arange(len(T)), rows)
    np.testing.assert_allclose(run.theta[:, 2], THETA2[kept], atol=1e-9)
    assert f"theta2: outliers removed: {len(rows)}" in run.notes
    assert not any("unwrapped" in note for note in run.notes)


def test_an_outlier_in_counts_is_left_out_too(tmp_path):
    counts = np.round(RIG.positions(np.column_stack([0 * T, THETA1, THETA2]))).astype(float)
    counts[70, 2] = 1e300
    file = table(tmp_path / "a.csv", ("time", "counts1", "counts2"), T, counts[:, 1], counts[:, 2])
    run = read(file, unit="counts")
    assert len(run.t) == len(T) - 1
    assert "theta2: outliers removed: 1" in run.notes


def test_a_logger_that_wraps_back_and_forth_at_its_end_is_unwrapped(tmp_path):
    turning = np.pi + 0.02 * np.sin(300 * T) + 0.5 * T  # noise across the end of the range, for a row at a time
    wrapped = (turning + np.pi) % (2 * np.pi) - np.pi
    run = read(table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T, wrapped, THETA2))
    np.testing.assert_allclose(np.diff(run.theta[:, 1]), np.diff(turning), atol=1e-9)
    assert run.notes[0] == "theta1: the logger wrapped this angle; the import unwrapped it"


def test_angles_of_many_turns_are_taken_as_they_are(tmp_path):
    turning = 30.0 * T  # five turns, and then rows that are missing
    kept = (T < 0.4) | (T > 0.7)
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), T[kept], turning[kept], THETA2[kept])
    run = read(file, scale={"theta1": 1.0})  # a uniform rotation is no swing
    np.testing.assert_allclose(run.theta[:, 1], turning[kept], atol=1e-9)


def test_a_column_that_is_empty_throughout_is_an_axis_that_was_not_recorded(tmp_path):
    nothing = np.full_like(T, np.nan)
    run = read(table(tmp_path / "a.csv", ("t", "theta0", "theta1", "theta2"), T, nothing, THETA1, THETA2))
    assert_the_swing(run)
    assert any("theta0: its column is empty" in note for note in run.notes)
    with pytest.raises(RunError, match="theta2 is empty; both rods are required"):
        read(table(tmp_path / "b.csv", ("t", "theta1", "theta2"), T, THETA1, nothing))


def test_rods_that_point_upwards_most_of_the_time_are_asked_about_where_too_little_is_seen(paper, tmp_path):
    short = T[:20]
    file = table(tmp_path / "a.csv", ("t", "theta1", "theta2"), short, 0.1 + short, 0.2 - short)
    asked = "both rods point upwards most of the time: if the table's zero is hanging, import it with --zero hanging"
    assert asked in import_csv(file, paper).notes
    assert asked not in import_csv(file, paper, ImportOptions(zero="hanging")).notes


@pytest.mark.parametrize("first", ["#Creator: logger\n", "\ufeff# a logger\n#\n"])
def test_a_comment_of_units_below_the_commented_names_is_no_header(tmp_path, first):
    rows = [f"{t:.12g}\t{a:.12g}\t{b:.12g}" for t, a, b in zip(T, THETA1, THETA2, strict=True)]
    names = "#Time A\ttheta1\ttheta2\n#[s]\t[rad]\t[rad]\n"
    (tmp_path / "a.txt").write_text(first + names + "\n".join(rows), encoding="utf-8")
    assert_the_swing(read(tmp_path / "a.txt", columns={"t": "Time A (s)"}))
    (tmp_path / "b.txt").write_text(first + names.replace("[rad]", "[au]") + "\n".join(rows), encoding="utf-8")
    with pytest.raises(RunError, match=re.escape("the table has: Time A (s), theta1 (au), theta2 (au)")):
        read(tmp_path / "b.txt", columns={"t": "Time"})
