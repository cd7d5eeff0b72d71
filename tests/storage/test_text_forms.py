"""Forms of text tables of real loggers: the same swing is read with the same angles from each."""

import json
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.tables.plausible import odd_notes
from dpr_lab.storage.tables.table import read_table
from dpr_lab.storage.tables.understand import understand
from tests.storage.swing_files import small_swing
from tests.storage.test_rod_alone import SWING, T

DEG = np.rad2deg(SWING)


def lines(form: str, values: np.ndarray = DEG) -> str:
    return "".join(form.format(t=t, ms=round(1e3 * t), angle=angle) for t, angle in zip(T, values, strict=True))


FORMS = {
    "spreadsheet, Unicode text": ("Time (s)\tAngle (deg)\n" + lines("{t:.2f}\t{angle:.4f}\n")).encode("utf-16"),
    "units in a row": "time,angle\ns,deg\n" + lines("{t:.2f},{angle:.4f}\n"),
    "function of Arduino": "millis,angle_deg\n" + lines("{ms},{angle:.4f}\n"),
    "plotter of Arduino": lines("t:{t:.2f},angle_deg:{angle:.4f}\n"),
    "labels and blanks": "ready\n" + lines("time: {t:.2f} angle_deg: {angle:.4f}\n"),
    "plotter and serial monitor": lines("12:03:0{t:.3f} -> angle_deg:{angle:.4f}\n"),
    "minus sign for print": "t,angle_deg\n" + lines("{t:.2f},{angle:.4f}\n").replace("-", "\N{MINUS SIGN}"),
    "French unit": "Temps (s);Angle (degrés)\n" + lines("{t:.2f};{angle:.4f}\n"),
    "German unit": "Zeit (s);Winkel (Grad)\n" + lines("{t:.2f};{angle:.4f}\n").replace(".", ","),
    "names of no known language": "时间,角度\n" + lines("{t:.2f},{angle:.6f}\n", SWING),
    "input with the letter of an angle": "time,angle,Q\n" + lines("{t:.2f},{angle:.6f},0\n", SWING),
    "columns twice": "t,theta (rad),,t,theta (rad)\n"
    + "".join(f"{t:.2f},{angle:.6f},,{t:.2f},{angle:.6f}\n" for t, angle in zip(T, SWING, strict=True)),
    "units in the fields": "time,angle\n" + lines("{t:.2f} s,{angle:.4f}°\n"),
    "separated thousands": "time_us;angle_deg\n"
    + "".join(f"{1e6 * t + 1e6:,.0f};{angle:.4f}\n" for t, angle in zip(T, DEG, strict=True)),
    "blanks before units": "Time (s) Angle (deg)\n" + lines("{t:.2f} {angle:.4f}\n"),
    "empty last column": "\tmass A\t\nt\tangle_deg\t\n" + lines("{t:.2f}\t{angle:.4f}\t\n"),
    "tabs after the numbers alone": "Monday\t17:15\tPeriod : 4 ms\t\tOpen Loop\n\nt\tangle_deg\n"
    + lines("{t:.2f}\t{angle:.4f}\t\n").replace(".", ","),
    "time in the last column": lines("{angle:.6f},{t:.2f}\n", SWING),
    "time and angle with their errors": "x y dx dy\n" + lines("{t:.2f}\t{angle:.6f}\t0.001\t{angle:.2f}\n", SWING),
    "an absolute angle and rates": "timestamp,omega,absolute_theta,gyroZ\n"
    + lines("{t:.2f},0,{angle:.6f},{angle:.3f}\n", SWING),
    "a comment of names with another separator": "# t   theta   error\n" + lines("{t:.2f}\t{angle:.6f}\t0\n", SWING),
    "a row for each quantity": "".join(",".join(f"{x:.6f}" for x in row) + "\n" for row in (T, SWING)),
    "a name before each row": "".join(
        name + "".join(f"\t{x:.6f}" for x in row) + "\n" for name, row in (("t", T), ("angle", SWING))
    ),
    "a row for each message": "time,position,angle\n"
    + "".join(f"{t - 0.004:.3f},{t:.3f},\n{t:.3f},,{angle:.6f}\n" for t, angle in zip(T, SWING, strict=True)),
    "separators after the numbers, names in a comment": "# angle,t\n" + lines("{angle:.6f},{t:.2f},\n", SWING),
    "decimal commas in quotation marks": '"time","angle (°)"\n'
    + "".join(f'"{t:.2f}","{angle:.4f}"\n'.replace(".", ",") for t, angle in zip(T, DEG, strict=True)),
    "names of devices above the names": "Card,Encoder\ntime [s],angle [deg]\n" + lines("{t:.2f},{angle:.4f}\n"),
    "settings above the names": "info,\namplitude,0.5\nt,angle_deg,cart\n" + lines("{t:.2f},{angle:.4f},0\n"),
    "a repeated header": "t,angle_deg\n"
    + (half := lines("{t:.2f},{angle:.4f}\n"))[:800]
    + half[800:].replace("\n", "\nt,angle_deg\n", 1),
    "counts of an encoder": "time_ms,encoder\n" + lines("{ms},{angle:.0f}\n", 16384 / 360 * DEG),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_swing_is_read_without_options(tmp_path, one, form):
    text = FORMS[form]
    file = tmp_path / "swing.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    run = import_csv(file, one, ImportOptions(zero="hanging"))
    np.testing.assert_allclose(run.theta[:, 1] - np.pi, SWING, atol=1e-3)
    np.testing.assert_allclose(run.t, T, atol=1e-9)


def test_a_date_and_a_time_of_day_may_have_a_column_each(tmp_path, one):
    (tmp_path / "a.csv").write_text("Date,Time,angle_deg\n" + lines("2026-03-01,14:30:0{t:.2f},{angle:.4f}\n"))
    run = import_csv(tmp_path / "a.csv", one, ImportOptions(zero="hanging"))
    np.testing.assert_allclose(run.t, T, atol=1e-9)


@pytest.mark.parametrize(
    "days", ["01.05.24 02.05.24", "5/1/24 5/2/24", "2024-05-01 2024-05-02", "05/01/2024 05/02/2024"]
)
def test_a_column_of_dates_continues_the_times_after_midnight(tmp_path, one, days):
    before, after = days.split()
    clocks = [f"{before},23:59:{59.5 + t:.2f}" if t < 0.495 else f"{after},00:00:0{t - 0.5:.2f}" for t in T]
    rows = "".join(f"{clock},{angle:.4f}\n" for clock, angle in zip(clocks, DEG, strict=True))
    (tmp_path / "a.csv").write_text("Date,Time,angle_deg\n" + rows)
    run = import_csv(tmp_path / "a.csv", one, ImportOptions(zero="hanging"))
    np.testing.assert_allclose(run.t, T, atol=1e-9)


def test_dates_of_two_time_zones_change_independently(tmp_path):
    rows = [
        f"01.01.2025 00:59:{59.5 + t:.2f},31.12.2024 23:59:{59.5 + t:.2f},1\n"
        if t < 0.495
        else f"01.01.2025 01:00:0{t - 0.5:.2f},01.01.2025 00:00:0{t - 0.5:.2f},1\n"
        for t in T
    ]
    (tmp_path / "a.csv").write_text("time,utc,theta\n" + "".join(rows))
    time, utc, _ = read_table(tmp_path / "a.csv").values
    np.testing.assert_allclose([time - time[0], utc - utc[0]], [T, T], atol=1e-9)


def test_dates_that_change_in_different_rows_are_one_midnight_of_a_time_without_a_date(tmp_path):
    rows = "01.01.2025 23:00:00,01.01.2025 23:59:59,23:59:59,1\n01.01.2025 23:00:01,02.01.2025 00:00:00,00:00:00,1\n"
    rows += "02.01.2025 00:00:00,02.01.2025 00:59:59,00:59:59,1\n"
    (tmp_path / "a.csv").write_text(f"time,utc,clock,theta\n{rows}")
    *clocks, _ = read_table(tmp_path / "a.csv").values
    np.testing.assert_allclose([clock - clock[0] for clock in clocks], [[0, 1, 3600]] * 3)


def test_a_repeated_header_is_noted(tmp_path):
    (tmp_path / "a.csv").write_text("t,angle\n0,1\n1,2\nt,angle\n2,3\n")
    assert read_table(tmp_path / "a.csv").notes == ("the header is repeated, first in line 4: these lines are ignored",)


@pytest.mark.parametrize("empty", ["nan,nan", ","])
def test_rows_without_values_are_no_repeated_header(tmp_path, one, empty):
    rows = lines("{angle:.5f},{t:.2f}\n", SWING).splitlines()
    rows[3:6] = [empty] * 3
    (tmp_path / "a.csv").write_text("\n".join(["theta1,other", empty, *rows]) + "\n")
    swing = understand(tmp_path / "a.csv", one, ImportOptions(zero="hanging", rate_hz=100))
    assert swing.since_first_s[-1] == pytest.approx(T[-1])
    assert "interruptions kept: 1, the longest 0.04 s" in swing.notes
    assert not any("header" in note for note in swing.notes)


def test_a_time_before_each_line_is_read(tmp_path, one):
    (tmp_path / "a.log").write_text(lines("14:03:{t:06.3f} -> {angle:.6f}\n", SWING))
    run = import_csv(tmp_path / "a.log", one, ImportOptions(zero="hanging"))
    np.testing.assert_allclose(run.theta[:, 1] - np.pi, SWING, atol=1e-5)


def test_a_point_in_one_column_is_read(tmp_path, one):
    """A tracker in Python wrote tuples of pixels."""
    x, y = (np.round(900 * part) for part in (np.sin(SWING), np.cos(SWING)))
    rows = zip(x, y, T, strict=True)
    text = "position (px),time,speed\n" + "".join(f'"({a:.0f}, {b:.0f})",{t:.2f},0.0\n' for a, b, t in rows)
    (tmp_path / "a.csv").write_text(text)
    run = import_csv(tmp_path / "a.csv", one)
    np.testing.assert_allclose(run.theta[:, 1] - np.pi, SWING, atol=5e-3)


def test_numbers_of_a_vector_have_names(tmp_path):
    (tmp_path / "a.csv").write_text('t;"m1 (px)";q\n0,5;(3 -4.5);[1e-1, 2]\n1,5;(4 5);[1, 2]\n')
    table = read_table(tmp_path / "a.csv")
    assert table.names == ("t", "m1_x (px)", "m1_y (px)", "q[0]", "q[1]")
    np.testing.assert_array_equal(np.column_stack(table.values)[0], [0.5, 3, -4.5, 0.1, 2])


def test_a_fall_without_names_is_read(tmp_path, one):
    (tmp_path / "a.csv").write_text("".join(f"{t:.2f}, {0.1 * np.cosh(3 * t):.6f}\n" for t in T[:60]))
    run = import_csv(tmp_path / "a.csv", one)
    np.testing.assert_allclose(run.theta[:, 1], 0.1 * np.cosh(3 * T[:60]), atol=1e-5)


@pytest.mark.parametrize(("names", "asks"), [("", True), ("t,bend\n", False)])
def test_a_column_without_a_name_may_be_a_distance(tmp_path, one, names, asks):
    (tmp_path / "a.csv").write_text(names + lines("{t:.2f},{angle:.4f}\n"))
    notes = understand(tmp_path / "a.csv", one, ImportOptions(zero="hanging")).notes
    assert any("interpreted as theta1" in note for note in notes)
    assert any("If it is a distance" in note for note in notes) == asks


def test_coordinates_next_to_an_angle_are_no_cart(tmp_path, one):
    (tmp_path / "a.csv").write_text("Time(s),X,Y,Angle(deg)\n" + lines("{t:.2f},{angle:.0f},{angle:.1f},{angle:.4f}\n"))
    notes = understand(tmp_path / "a.csv", one, ImportOptions(zero="hanging")).notes
    assert not any("cart" in note for note in notes)


def test_a_row_that_lacks_a_label_is_refused(tmp_path, one):
    (tmp_path / "a.csv").write_text(lines("t:{t:.2f},angle:{angle:.4f}\n") + "t:1.0\nt:1.01,angle:3\n")
    with pytest.raises(RunError, match="line 101 has 1 fields"):
        import_csv(tmp_path / "a.csv", one)


def test_separators_of_thousands_are_read(tmp_path):
    (tmp_path / "a.csv").write_text("t;x;y\n1,5;1.234,5;-1.002.003,25\n2,5;0,5;7,0\n")
    (tmp_path / "b.csv").write_text('t,x,y\n1.5,"1,234.5","-1,002,003.25"\n2.5,0.5,7\n')
    for name in ("a.csv", "b.csv"):
        table = read_table(tmp_path / name)
        np.testing.assert_array_equal(np.column_stack(table.values), [[1.5, 1234.5, -1002003.25], [2.5, 0.5, 7.0]])


@pytest.mark.parametrize("sign", [".", ","])
def test_a_number_that_begins_with_zero_has_no_thousands(tmp_path, sign):
    """Three decimals after a comma look like a group of three digits."""
    values = np.array([[0.01, 0.956], [0.02, -0.1], [0.03, 1.234]])
    rows = [(f"{t:.3f}".replace(".", sign), f"{x:.3f}".replace(".", ",")) for t, x in values]
    rows = [f'"{t}","{x}"' for t, x in rows]
    (tmp_path / "a.csv").write_text("t,x\n" + "\n".join(rows) + "\n")
    np.testing.assert_array_equal(np.column_stack(read_table(tmp_path / "a.csv").values), values)


def test_a_sign_for_print_does_not_make_thousands_decimal(tmp_path):
    (tmp_path / "a.csv").write_text('t,x\n0.5,"\N{MINUS SIGN}1,234"\n1.5,"2,500"\n')
    np.testing.assert_array_equal(read_table(tmp_path / "a.csv").values[1], [-1234, 2500])


def test_different_units_in_a_column_are_refused(tmp_path, one):
    text = "time,angle\n" + lines("{t:.2f},{angle:.4f} deg\n") + "1.0,1.2 rad\n"
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(RunError, match=r"line 102: '1.2 rad' in column 'angle \(deg\)' is not a number"):
        import_csv(tmp_path / "a.csv", one)


def test_names_that_belong_to_no_column_are_refused_by_name(tmp_path, one):
    (tmp_path / "a.txt").write_text("x y dx dy\n" + lines("{t:.2f} {angle:.4f}\n"))
    with pytest.raises(RunError, match=r"the header has 4 names \(x, y, dx, dy\), but line 2 has 2 fields"):
        import_csv(tmp_path / "a.txt", one)


def test_errors_next_to_x_and_y_are_no_second_point(tmp_path, one):
    """Programs for plots name time and angle x and y, and their errors x' and y'."""
    (tmp_path / "a.txt").write_text("X Y X' Y'\n" + lines("{t:.2f} {angle:.6f} 0.01 {angle:.2f}\n", SWING))
    with pytest.raises(RunError, match=r"no single column found for theta1; the table has: X, Y, X', Y'"):
        import_csv(tmp_path / "a.txt", one)
    run = import_csv(tmp_path / "a.txt", one, ImportOptions(zero="hanging", columns={"theta1": "Y"}))
    np.testing.assert_allclose(run.theta[:, 1] - np.pi, SWING, atol=1e-5)


def test_names_may_be_separated_otherwise_than_a_spreadsheet_separates_its_cells(tmp_path, one):
    """The names stand in one cell; time and angle are named x and y, and two frames have the same rounded time."""
    times = np.minimum(np.arange(len(SWING)) / 100, (len(SWING) - 2) / 100)
    rows = (f"{t:.2f}\t{angle:.6f}\t0.01\t0.05\n" for t, angle in zip(times, SWING, strict=True))
    (tmp_path / "a.txt").write_text("x y dx dy\t\t\t\n" + "".join(rows))
    with pytest.raises(RunError, match="no single column found for t and theta1; the table has: x, y, dx, dy"):
        import_csv(tmp_path / "a.txt", one)
    run = import_csv(tmp_path / "a.txt", one, ImportOptions(zero="hanging", columns={"t": "x", "theta1": "y"}))
    np.testing.assert_allclose(run.theta[:90, 1] - np.pi, SWING[:90], atol=1e-5)


@pytest.mark.parametrize("rates", [["Gyroscope x (rad/s)", "Gyroscope y (rad/s)", "Absolute (rad/s)"], ["omega"]])
def test_rates_are_no_angles(tmp_path, one, rates):
    """Tables of the app phyphox and of one rate."""
    row = "{t:.2f}" + "".join(f",{{angle:.{digits}f}}" for digits, _ in enumerate(rates, 4)) + "\n"
    (tmp_path / "a.csv").write_text(",".join(["Time (s)", *rates]) + "\n" + lines(row, SWING))
    with pytest.raises(RunError, match="None of them is an angle: export the angle of the rod"):
        import_csv(tmp_path / "a.csv", one)


def test_the_angle_of_an_inertial_sensor_is_an_angle(tmp_path, one):
    (tmp_path / "a.csv").write_text("t,acc angle\n" + lines("{t:.2f},{angle:.6f}\n", SWING))
    run = import_csv(tmp_path / "a.csv", one, ImportOptions(zero="hanging"))
    np.testing.assert_allclose(run.theta[:, 1] - np.pi, SWING, atol=1e-5)


def test_a_table_of_times_is_not_called_a_table_of_rates(tmp_path, one):
    (tmp_path / "a.csv").write_text("time_s,time_ms\n" + lines("{t:.2f},{angle:.6f}\n", SWING))
    with pytest.raises(RunError) as refused:
        import_csv(tmp_path / "a.csv", one)
    assert "None of them is an angle" not in str(refused.value)


def test_a_single_column_without_a_header_has_the_number_1(tmp_path, one):
    (tmp_path / "a.csv").write_text(lines("{angle:.6f}\n", SWING))
    options = ImportOptions(zero="hanging", rate_hz=100.0, columns={"theta1": "1"})
    np.testing.assert_allclose(import_csv(tmp_path / "a.csv", one, options).theta[:, 1] - np.pi, SWING, atol=1e-5)


def test_the_error_and_the_speed_of_a_controller_are_no_angles(tmp_path, one):
    (tmp_path / "a.json").write_text(json.dumps([{"err": a, "vel": 2 * a} for a in SWING.tolist()]))
    with pytest.raises(RunError, match="no single column found for theta1; the table has: err, vel"):
        import_csv(tmp_path / "a.json", one, ImportOptions(rate_hz=100.0))


def test_a_message_names_only_the_first_of_many_columns(tmp_path, one):
    (tmp_path / "a.csv").write_text("".join(",".join(map(str, T + row)) + "\n" for row in range(20)))
    with pytest.raises(RunError, match="18, 19, 20 and 80 more"):
        import_csv(tmp_path / "a.csv", one)


def test_a_turned_camera_is_named(tmp_path, one):
    """Points of a camera on its side: the rod hangs to the left in the picture."""
    t = np.arange(0, 5, 1 / 30)
    angle = 0.5 * np.exp(-0.05 * t) * np.cos(6.7 * t)
    x, y = -700 * np.cos(angle), 700 * np.sin(angle)
    noisy = np.column_stack([t, np.stack([x, y], 1) + np.random.default_rng(2).normal(0, 4, (len(t), 2))])
    np.savetxt(tmp_path / "a.csv", noisy, "%.4f", ",", header="t,x,y", comments="")
    questions = understand(tmp_path / "a.csv", one, ImportOptions()).questions
    (named,) = [q.sentence for q in questions if "camera is turned" in q.sentence]
    offset = float(named.rpartition("--offset ")[2].rstrip(")"))
    assert abs(offset) == pytest.approx(np.pi / 2, abs=0.05)
    assert not understand(tmp_path / "a.csv", one, ImportOptions(offset={"theta1": offset})).questions


def test_whole_numbers_that_change_too_fast_for_radians_may_be_counts():
    counts = np.round(1000 / 360 * DEG)
    theta = np.column_stack([0 * T, counts + np.pi, 0 * T])
    (note,) = odd_notes(T, theta, upright=False, rods=1, in_radians=True)
    assert "whole numbers are usually degrees (--unit deg), or counts of an encoder (--unit counts" in note
    (note,) = odd_notes(T, np.round(0.05 * theta), upright=False, rods=2, in_radians=True)
    assert "the rods turn in steps of whole radians: whole numbers are usually degrees (--unit deg)" in note
    (note,) = odd_notes(T, 1.01 * theta, upright=False, rods=1, in_radians=True)
    assert "are the units correct" in note


@pytest.mark.parametrize("zero", ["hanging", "upright"])
def test_angles_in_mrad_are_questioned_without_a_correction(tmp_path, one, zero):
    t = np.arange(0, 4, 0.02)
    swing = 1e3 * 1.1 * np.exp(-0.05 * t) * np.cos(2 * np.pi / 0.95 * t)
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, swing]), "%.5g", ",", header="t,theta", comments="")
    shown = understand(tmp_path / "a.csv", one, ImportOptions(zero=zero))
    assert "are the units correct (--unit, --scale, --time-unit)?" in shown.questions[0].sentence
    assert not shown.mend


@pytest.mark.parametrize("name", ["theta (mrad)", "thetamrad", "angle [milliradians]", "sensor A (mrad)"])
def test_a_column_in_mrad_requires_a_scale(tmp_path, one, name):
    rows = lines("{t:.2f},{angle:.6f}\n", 1e3 * SWING)
    (tmp_path / "a.csv").write_text(f"t,{name}\n" + rows)
    with pytest.raises(RunError, match=r"is in mrad by its name: convert it \(--scale 0.001\)"):
        import_csv(tmp_path / "a.csv", one, ImportOptions(zero="hanging"))
    scaled = ImportOptions(zero="hanging", scale={"theta1": 1e-3})
    np.testing.assert_allclose(import_csv(tmp_path / "a.csv", one, scaled).theta[:, 1] - np.pi, SWING, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "per_radian", "unit", "scale"),
    [
        ("angle_gon", 200 / np.pi, "deg", 0.9),
        ("theta (turns)", 0.5 / np.pi, "deg", 360.0),
        ("theta_cdeg", 18000 / np.pi, "deg", 0.01),
        ("theta_e3", 1000.0, None, 0.001),
    ],
)
def test_a_column_in_a_unit_with_a_factor_requires_its_scale(tmp_path, one, name, per_radian, unit, scale):
    rows = lines("{t:.2f},{angle:.8f}\n", per_radian * SWING)
    (tmp_path / "a.csv").write_text(f"t,{name}\n" + rows)
    with pytest.raises(RunError, match=f"by its name: convert it .*--scale {scale:g}"):
        import_csv(tmp_path / "a.csv", one, ImportOptions(zero="hanging"))
    scaled = ImportOptions(zero="hanging", unit=unit, scale={"theta1": scale})
    np.testing.assert_allclose(import_csv(tmp_path / "a.csv", one, scaled).theta[:, 1] - np.pi, SWING, atol=1e-5)


def test_a_swing_in_degrees_is_named(tmp_path, one):
    t = np.arange(0, 6, 0.01)
    angle = np.rad2deg(small_swing(t, np.deg2rad(20)))
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, angle]), "%.2f", ",", header="t,theta")
    assert understand(tmp_path / "a.csv", one, ImportOptions(zero="hanging")).mend == ("--unit", "deg")


def test_whole_numbers_of_a_swing_are_counts(tmp_path, one):
    t = np.arange(0, 6, 0.01)
    counts = small_swing(t, 0.3) / 2 / np.pi * 4096
    np.savetxt(tmp_path / "a.csv", np.column_stack([100 * t, counts]), "%d", ",", header="t,theta")
    shown = understand(tmp_path / "a.csv", one, ImportOptions(zero="hanging", rate_hz=100))
    assert shown.mend == ("--unit", "counts")


@pytest.mark.parametrize("step", [1, 2])
def test_frames_under_the_name_of_a_time_are_explained(tmp_path, one, step):
    swing = 1.2 * np.cos(0.09 * np.arange(1000))
    rows = "".join(f"{step * frame},{angle:.6f}\n" for frame, angle in enumerate(swing))
    (tmp_path / "a.csv").write_text("t,angle\n" + rows)
    sentence = r"periods of 0.93 s: the column numbers the rows or frames \(--rate-hz, about 59 Hz\), or .* in ms"
    with pytest.raises(RunError, match=sentence):
        import_csv(tmp_path / "a.csv", one)


def test_row_numbers_below_the_name_of_a_time_are_no_time_if_another_column_is(tmp_path, one):
    t = 0.02 * np.arange(200)
    rows = [f"{350 + k};{angle:.5f};{8.75 + t[k]:.2f}\n" for k, angle in enumerate(small_swing(t, 0.3))]
    (tmp_path / "a.csv").write_text("Time;Amplitude;\n" + "".join(rows))
    with pytest.raises(RunError, match=r"'Time' counts the rows, but 'column 3.*by 0.02 .*\(--columns t='column 3"):
        import_csv(tmp_path / "a.csv", one)
    for time, unit, step in (("3", "s", 0.02), ("Time", "ms", 0.001)):
        options = ImportOptions(zero="hanging", columns={"t": time, "theta1": "2"}, time_unit=unit)
        np.testing.assert_allclose(np.diff(import_csv(tmp_path / "a.csv", one, options).t), step, atol=1e-9)


@pytest.mark.parametrize(
    ("unit", "sentence"),
    [
        ("s", "too few rows per period.*ms"),
        ("ms", "periods of 0.93 s. In s the rows .* the column is not an angle .*--scale"),
    ],
)
def test_neither_unit_of_time_is_proposed_for_another_quantity(tmp_path, one, unit, sentence):
    """The size of the acceleration at a swinging rod, in thousandths of g."""
    milliseconds = np.arange(0, 1200, 10)
    size = 1000 + 300 * np.sin(0.02 * milliseconds) + np.random.default_rng(1).normal(0, 50, len(milliseconds))
    np.savetxt(tmp_path / "a.csv", np.column_stack([milliseconds, size]), delimiter=",", header="t,angle", comments="")
    with pytest.raises(RunError, match=sentence):
        import_csv(tmp_path / "a.csv", one, ImportOptions(unit=None, time_unit=unit))


@pytest.mark.parametrize("name", ["thetadeg", "theta1deg", "θ₁ (°)", "θ1 [°]", "theta_1 (º)", "ϑ₁[deg]", "thetagrados"])
def test_degrees_in_the_name_of_a_column_are_recognised(one: Rig, tmp_path: Path, name: str) -> None:
    file = tmp_path / "swing.csv"
    file.write_text(f"t,{name}\n" + lines("{t:.2f},{angle:.4f}\n"), encoding="utf-8")
    run = import_csv(file, one, ImportOptions(zero="hanging"))
    assert run.theta[:, 1] == pytest.approx(SWING + np.pi, abs=1e-5)
    assert not any("interpreted" in note for note in run.notes)
