"""Creation of a rig file from lengths and masses, by options or prompts, and its check."""

import os
import pty
import re
import runpy
import select
import time
from pathlib import Path

import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.rig import load_rig, parse_rig
from dpr_lab.workflows.rig_file import RigMeasures, check_rig, draft_rig
from dpr_lab.workflows.rig_toml import Measure
from tests.warm_process import started

ROOT = Path(__file__).parents[2]
FLAGS = ("--name", "bench", "--l1", "0.3", "--l2", "0.25", "--m1", "0.21+-0.001", "--m2", "0.12")


def test_keys_that_do_not_fit_together_have_one_sentence() -> None:
    text = (ROOT / "configs" / "rigs" / "furuta.toml").read_text(encoding="utf-8")
    without_motor = re.sub(r"\[motor\]\n(.+\n)+", "", text)
    with pytest.raises(ConfigError, match=r"^[^:]+: a driven arm needs \[motor\] with its input in the rig file$"):
        parse_rig(without_motor)


@pytest.mark.parametrize(
    ("words", "warnings"),
    [
        ((), []),
        (("--m2", "10"), ["parameters.m2: 10 kg is a large mass for a rod of 0.25 m: was it weighed in another unit?"]),
        (("--l1", "3"), ["rig.L1: 3 m: was it measured in another unit?"]),
    ],
)
def test_a_new_rig_with_a_length_in_mm_or_a_mass_in_g_has_a_warning(cli, tmp_path: Path, words, warnings) -> None:
    done = cli("rig", "new", *FLAGS, *words, "--mb", "0.05", "--out", "my.toml", cwd=tmp_path)
    assert done.code == 0
    assert [line.removeprefix("warning: ") for line in done.err.splitlines() if "unit?" in line] == warnings


def test_a_mass_that_no_rod_can_have_is_refused_with_its_key_and_value(cli, tmp_path: Path) -> None:
    rig = changed(tmp_path, "measured = 0.21\n", "measured = 210.0\n")
    sentence = "210 kg is impossible on a rod of 0.3 m (at most 30 kg): give masses in kg"
    with pytest.raises(ConfigError, match=re.escape(f"rig.toml: parameters.m1: {sentence}")) as refused:
        load_rig(rig)
    assert refused.value.keys == ["parameters.m1"]
    assert [(finding.state, finding.text) for finding in check_rig(rig)] == [("wrong", sentence)]
    done = cli("rig", "new", *FLAGS, "--m2", "120", "--mb", "50", "--out", "my.toml", cwd=tmp_path)
    assert done.code == 3
    assert all(f"parameters.{key}" in done.err for key in ("m2: 120 kg", "mb: 50 kg"))
    assert not (tmp_path / "my.toml").exists()


FINDINGS = {
    values: [
        {
            "state": "missing",
            "key": "parameters",
            "text": "the measured values (measured, std) do not determine the scale of masses and torques: only ratios"
            f" can be identified. Measure {values}, or record another swing with an added mass or a known torque of a"
            " joint",
        }
    ]
    for values in ("m2 and l2", "m1, l1 and mb")
}


def test_a_name_with_a_control_character_is_refused_as_a_name(cli, tmp_path: Path) -> None:
    """TOML forbids U+007F in a string, JSON does not; the message is about the name and not about the file."""
    done = cli("rig", "new", *FLAGS, "--name", "a\x7fb", "--out", "my.toml", cwd=tmp_path)
    assert (done.code, "contains characters that cannot be displayed" in done.err) == (3, True)


def test_a_rig_file_from_flags_can_be_used(cli, tmp_path: Path) -> None:
    done = cli("rig", "new", *FLAGS, "--out", "my.toml", cwd=tmp_path)
    assert done.code == 0, done.err
    rig = load_rig(tmp_path / "my.toml")
    assert (rig.name, rig.L1, rig.L2) == ("bench", 0.3, 0.25)
    assert (rig.parameters["m1"].measured, rig.parameters["m1"].std) == (0.21, 0.001)
    assert rig.parameters["m2"].measured is None
    assert "# mass of the inner rod, kg" in (tmp_path / "my.toml").read_text()
    assert cli("rig", "check", "my.toml", "--json", cwd=tmp_path).json == {
        "file": "my.toml",
        "ok": True,
        "findings": FINDINGS["m2 and l2"],
    }
    again = cli("rig", "new", *FLAGS, "--out", "my.toml", cwd=tmp_path)
    assert again.code == 3
    assert "exists already" in again.err


def test_a_fault_of_a_single_rod_is_reported_only_for_this_rod(cli, tmp_path: Path) -> None:
    words = ("--rods", "inner", "--l1", "0.3", "--m1", "0.21+-0.001", "--name", "bob", "--out", "my.toml")
    assert cli("rig", "new", *words, cwd=tmp_path).code == 0
    text = (tmp_path / "my.toml").read_text()
    assert "A measured value has `nominal`, `measured` and `std`, and no bounds" in text
    assert "# Measured m1 and l1 together determine the scale of all masses and torques" in text
    with pytest.raises(ConfigError, match=r"^[^\n]*parameters\.m1\.nominal: is missing$"):
        parse_rig(text.replace("nominal = 0.21\n", ""))


def test_flags_describe_arm_length_geared_joints_zeros_and_mounted_rods(cli, tmp_path: Path) -> None:
    words = ("--l0", "0.4", "--l1-std", "0.002", "--geared", "2", "--geared", "1", "--rezeroed", "--rods", "inner")
    assert cli("rig", "new", *FLAGS, *words, "--out", "my.toml", cwd=tmp_path).code == 0
    rig = load_rig(tmp_path / "my.toml")
    assert (rig.rig.L0, rig.rig.L1_std, rig.joints.geared) == (0.4, 0.002, (1, 2))
    assert rig.encoders.rezeroed
    assert rig.rods.mounted == "inner"
    assert cli("rig", "check", "my.toml", "--json", cwd=tmp_path).json["findings"] == FINDINGS["m1, l1 and mb"]


ONE = ("--name", "qube", "--rods", "inner", "--l1", "0.129", "--m1", "0.024")


def test_a_single_rod_is_checked_without_the_missing_one(cli, tmp_path: Path) -> None:
    heavy = ("--name", "p", "--rods", "inner", "--l1", "0.4", "--out", "p.toml", "--m1")
    refused = cli("rig", "new", *heavy, "150", cwd=tmp_path)
    assert (refused.code, refused.err.count("give masses in kg")) == (3, 1)
    assert cli("rig", "new", *heavy, "15", cwd=tmp_path).code == 0
    findings = cli("rig", "check", "p.toml", "--json", cwd=tmp_path).json["findings"]
    assert [(finding["state"], finding["key"]) for finding in findings] == [
        ("missing", "parameters"),
        ("odd", "parameters.m1"),
    ]


def test_flags_describe_one_rod_on_an_arm_with_a_motor(cli, tmp_path: Path) -> None:
    motor = ("--input", "voltage", "--kt", "0.042", "--ke", "0.042", "--resistance", "8.4+-0.1", "--gear", "2")
    words = (*ONE, "--l0", "0.085", "--l0-std", "0.001", "--arm", "driven", *motor)
    done = cli("rig", "new", *words, "--out", "qube.toml", cwd=tmp_path)
    assert done.code == 0, done.err
    rig = load_rig(tmp_path / "qube.toml")
    assert (rig.L0, rig.L1, rig.rods.mounted, rig.arm.mode) == (0.085, 0.129, "inner", "driven")
    assert rig.rig.L0_std == 0.001
    assert rig.motor is not None
    assert rig.motor.model_dump(include={"input", "gear"}) == {"input": "voltage", "gear": 2.0}
    table, built_in = rig.model_dump(), load_rig("furuta").model_dump()
    assert (table["motor"]["kt"]["nominal"], table["motor"]["R"]["std"]) == (0.042, 0.1)
    drafted, usual = table["parameters"] | table["arm"], built_in["parameters"] | built_in["arm"]
    for name in ("l1", "m1", "J1", "c1", "A"):
        assert drafted[name]["lower"] < usual[name]["nominal"] < drafted[name]["upper"], name
    assert cli("rig", "check", "qube.toml", "--json", cwd=tmp_path).json["ok"]


def test_flags_give_the_encoder_of_the_arm_another_number_of_counts(cli, tmp_path: Path) -> None:
    words = (*ONE, "--l0", "0.085", "--arm", "driven", "--input", "torque", "--counts-per-rev", "4096")
    done = cli("rig", "new", *words, "--arm-counts-per-rev", "1000", "--out", "qube.toml", cwd=tmp_path)
    assert done.code == 0, done.err
    assert load_rig(tmp_path / "qube.toml").encoders.counts_per_rev == (1000, 4096, 4096)


def test_flags_describe_an_inner_rod_that_is_prescribed(cli, tmp_path: Path) -> None:
    assert cli("rig", "new", *FLAGS, "--inner", "prescribed", "--out", "servo.toml", cwd=tmp_path).code == 0
    rig = load_rig(tmp_path / "servo.toml")
    assert (rig.joints.inner, rig.joints.geared) == ("prescribed", ())
    done = cli("identifiability", "--rig", "servo.toml", cwd=tmp_path)
    assert done.code == 3
    assert (
        "the inner rod of rig bench is prescribed: its motion, which determines the identifiable parameters" in done.err
    )


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ((*ONE, "--arm", "free"), 3, "an arm that is free needs its length: give --l0"),
        ((*ONE, "--l0", "0.1", "--arm", "driven"), 3, "needs the quantity of its input column: give --input"),
        ((*ONE, "--l0", "0.1", "--arm", "free", "--input", "torque"), 3, "--input torque needs --arm driven"),
        ((*ONE, "--l0", "0.1", "--kt", "0.04"), 2, "--kt requires a driven arm"),
        ((*ONE, "--l0", "0.1", "--arm", "driven", "--input", "torque", "--kt", "1"), 3, "for which kt has no meaning"),
        ((*ONE, "--l0", "0.1", "--arm", "driven", "--input", "current", "--kt", "x"), 2, "--kt 'x': write the value"),
        ((*FLAGS, "--geared", "3"), 3, "joints.geared"),
        ((*FLAGS, "--rods", "outer", "--elbow", "clamped"), 3, "no elbow to clamp"),
        (FLAGS[:-2], 2, "--m2 is required: Mass of the outer rod, kg"),
        (
            (*FLAGS[:-1], "heavy"),
            2,
            "--m2 'heavy': write the value as 0.21, or as 0.21+-0.001 if weighed (a weighed mass is not identified)",
        ),
        ((*FLAGS[:-1], "-1"), 3, "m2 must be above 0 and finite, not -1"),
        ((*FLAGS, "--l1", "-0.3"), 3, "L1 must be above 0 and finite, not -0.3"),
        ((*FLAGS, "--mb", "nan"), 3, "mb must be above 0 and finite, not nan; omit --mb if the mass is unknown"),
        ((*FLAGS, "--l1", "300"), 3, "rig.L1 = 300"),
        ((*FLAGS, "--out", "rig.txt"), 3, "ends in .toml"),
    ],
)
def test_what_no_rig_file_may_hold(cli, tmp_path: Path, words: tuple[str, ...], code: int, message: str) -> None:
    done = cli("rig", "new", *words, cwd=tmp_path)
    assert (done.code, list(tmp_path.iterdir())) == (code, [])
    assert message in " ".join(done.err.split())
    assert "Traceback" not in done.err


@pytest.mark.slow
def test_missing_values_are_prompted_for_on_a_terminal(tmp_path: Path) -> None:
    answers = {
        "Name of the rig": "asked",
        "Distance between the two joints": "0.3",
        "Mass of the inner rod": "0.21",
        "Length of the outer rod": "far\n0.25",  # asked again after a word
        "Mass of the outer rod": "0.12+-0.002",
        "Mass of the parts at joint 2": "",
        "Encoder of the outer rod": "absolute",
        "Counts per turn": "",
        "Link to the device": "",
    }
    master, slave = pty.openpty()
    process = started("dpr_lab", ["rig", "new"], stdin=slave, stdout=slave, stderr=slave, cwd=tmp_path)
    os.close(slave)
    shown, deadline = "", time.monotonic() + 120
    waiting = [(question, line) for question, answer in answers.items() for line in answer.split("\n")]
    while waiting:
        assert select.select([master], [], [], max(0.0, deadline - time.monotonic()))[0], (waiting[0], shown)
        shown += os.read(master, 4096).decode()
        if waiting[0][0] in shown and shown.rstrip().endswith(":"):
            os.write(master, (waiting.pop(0)[1] + "\n").encode())
            shown = ""
    assert process.wait(60) == 0, shown
    os.close(master)
    rig = load_rig(tmp_path / "asked.toml")
    assert (rig.L2, rig.parameters["m2"].std, rig.encoders.joint2) == (0.25, 0.002, "absolute")


def test_bounds_hold_rods_of_every_kind() -> None:
    measures = RigMeasures("published", 0.4, 0.4, Measure(0.1), Measure(0.1))
    rig, published = parse_rig(draft_rig(measures)), load_rig("paper")
    lower, upper = rig.bounds
    assert ((lower <= published.nominal) & (published.nominal <= upper)).all()
    real = load_rig("multiarm")
    measures = RigMeasures("real", real.L1, 0.23, Measure(0.0938), Measure(0.1376))
    lower, upper = parse_rig(draft_rig(measures)).bounds
    assert ((lower <= real.nominal) & (real.nominal <= upper)).all()


def changed(tmp_path: Path, old: str, new: str) -> Path:
    path = tmp_path / "rig.toml"
    text = draft_rig(RigMeasures("x", 0.3, 0.25, Measure(0.21, 0.001), Measure(0.12)))
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.mark.parametrize(
    ("old", "new", "state", "key"),
    [
        ("g = 9.81", "g = 98.1", "odd", "rig.g"),
        ("L1 = 0.3 ", "L1 = 3.0 ", "odd", "rig.L1"),
        ("measured = 0.21\n", "measured = 21.0\n", "odd", "parameters.m1"),
        ("measured = 0.21\n", "measured = 210.0\n", "wrong", "parameters.m1"),
        ("std = 0.001", "std = 0.1", "odd", "parameters.m1"),
        ("measured = 0.21\nstd = 0.001", "lower = 0.2\nupper = 0.3", "missing", "parameters"),
        ("nominal = 0.15\n", "nominal = 0.35\n", "odd", "parameters.l1"),
        ("nominal = 0.000625\n", "nominal = 0.0063\n", "odd", "parameters.J2"),
        ("lower = 5.25e-05", "lower = 1e-9", "odd", "parameters.J2"),
        ("theta1 = 0.1\ntheta2 = 0.1", "theta1 = 3.14\ntheta2 = 3.14", "odd", "poses.X2"),
        ("theta1 = 0.1\ntheta2 = 0.1", "theta1 = 90.0\ntheta2 = 5.7", "odd", "poses.X2"),
        ("rate_hz = 1000", "rate_hz = 20", "odd", "link.rate_hz"),
        ('url = "sim://"', 'url = "bluetooth://rig"', "odd", "link.url"),
        ("# noise_counts = 0.5 ", "noise_counts = 0.0 ", "odd", "encoders.noise_counts"),
        ("L2 = 0.25", "# L2 = 0.25", "missing", "rig.L2"),
        ("[poses.X1]", "[pose.X1]", "wrong", "pose"),
        ("rate_hz = 1000", 'rate_hz = "fast"', "wrong", "link.rate_hz"),
    ],
)
def test_wrong_missing_and_implausible_entries_are_reported(
    tmp_path: Path, old: str, new: str, state: str, key: str
) -> None:
    result = check_rig(changed(tmp_path, old, new))
    assert (state, key) in [(finding.state, finding.key) for finding in result], result
    assert not any(finding.text.startswith(finding.key or " ") for finding in result)


def test_the_range_of_gravity_is_that_of_the_page(tmp_path: Path) -> None:
    text = next(
        finding.text for finding in check_rig(changed(tmp_path, "g = 9.81", "g = 9.7")) if finding.key == "rig.g"
    )
    assert text == "9.7 m/s^2; on earth it is 9.76 to 9.84"
    assert "on earth 9.76 to 9.84" in (ROOT / "docs" / "rig-file.md").read_text(encoding="utf-8")


def test_a_rig_that_cannot_be_used_ends_with_1(cli, tmp_path: Path) -> None:
    done = cli("rig", "check", changed(tmp_path, "L1 = 0.3 ", "L1 = -0.3 "))
    assert done.code == 1
    assert re.search(r"cannot be used.*rig\.L1", done.out, re.DOTALL)
    assert cli("rig", "check", "paper").code == 0


def test_the_page_of_the_rig_file_is_what_the_model_says() -> None:
    page = runpy.run_path(str(ROOT / "docs" / "rig_file.py"))["page"]()
    assert (ROOT / "docs" / "rig-file.md").read_text(encoding="utf-8") == page


def test_a_simulator_model_becomes_a_rig_file(cli, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    inertial = '<inertial pos="0 0 .1" mass=".2" diaginertia="1e-3 1e-3 1e-3"/>'
    inner = f'<body><joint name="shoulder" axis="0 1 0"/>{inertial}'
    outer = f'<body pos="0 0 .25"><joint name="elbow" axis="0 1 0" frictionloss=".03"/>{inertial}</body></body>'
    text = f'<mujoco model="own"><worldbody>{inner}{outer}</worldbody></mujoco>'
    (tmp_path / "model.xml").write_text(text, encoding="utf-8")
    done = cli("rig", "from", "model.xml", "--joints", "shoulder, elbow", "--out", "a.toml", "--json", cwd=tmp_path)
    assert done.code == 0, done.err
    assert done.json["terms"] == [{"joint": "elbow", "quantity": "Coulomb friction", "value": 0.03, "unit": "N m"}]
    assert load_rig(tmp_path / "a.toml").name == "own"
    again = cli("rig", "from", "model.xml", "--out", "a.toml", cwd=tmp_path)
    assert (again.code, "exists already" in again.err) == (3, True)
    shown = cli("rig", "from", "model.xml", "--out", "b.toml", cwd=tmp_path)
    assert "Coulomb friction" in shown.out
