"""Printed diagnosis: short output with the main results, and all tables with --verbose."""

from pathlib import Path

import pytest

from dpr_lab.cli.diagnose import show, show_files
from dpr_lab.effects import EFFECTS
from tests.a_diagnosis import CLOCK, interval, made

RIVAL = {"name": "base_tilt", "class": ["base_tilt"], "instead_of": CLOCK, "cosine": 0.9}
RUNS = {f"run{k}": 0.90 + 0.01 * k for k in range(9)}


def printed(capsys: pytest.CaptureFixture[str], *, verbose: bool, probability: float = 0.001) -> str:
    diagnosis = made(rivals=[{**RIVAL, "probability": probability}])
    closed = diagnosis.gap.closed_held_out.model_copy(update={"per_run": RUNS})
    gap = diagnosis.gap.model_copy(update={"closed_held_out": closed})
    show(diagnosis.model_copy(update={"gap": gap}), Path("out"), verbose=verbose)
    return capsys.readouterr().out


def test_the_short_output_has_no_table_of_details(capsys: pytest.CaptureFixture[str]) -> None:
    short, whole = printed(capsys, verbose=False), printed(capsys, verbose=True)
    for title in ("Contributions of the effects", "Alternatives", "Possible checks"):
        assert title not in short
        assert title in whole
    assert "the 6 smallest of 9" in short
    assert [name in short for name in RUNS] == [True] * 6 + [False] * 3
    assert all(name in whole for name in RUNS)
    assert len(short.splitlines()) < 0.6 * len(whole.splitlines())


def test_a_probable_alternative_is_in_the_short_output(capsys: pytest.CaptureFixture[str]) -> None:
    assert "Probable alternatives" not in printed(capsys, verbose=False)
    assert "Probable alternatives" in printed(capsys, verbose=False, probability=0.2)


def test_a_step_names_its_check_and_the_command_its_file(capsys: pytest.CaptureFixture[str]) -> None:
    short = printed(capsys, verbose=False)
    [step] = (line for line in short.splitlines() if line.startswith("1. "))
    assert step.startswith(f"1. {EFFECTS[CLOCK].bench_check}")
    assert step.endswith("[check 1-abcd, expected information at most 1.00 bits; or instead: check 2-abcd]")
    assert "dpr-lab check out/diagnosis.json CHECK, followed by --value " in short


def test_sizes_of_the_common_effects_follow_the_verdict(capsys: pytest.CaptureFixture[str]) -> None:
    size = {"value": -0.0212, "interval90": [-0.0361, -0.00629]}
    zero = {"name": "encoder_offset_joint1", "class": ["encoder_offset_joint1"], "parameters": {"offset_rad": size}}
    show(made(verdict="unexplained", effects=[], common=[{**zero, "share": 0.44}]))
    _, verdict, common = capsys.readouterr().out.partition("Fit of the common effects alone")
    assert verdict
    assert all(words in common for words in ("encoder offset, joint 1", "offset -21.2 mrad (-36.1 to -6.29)", "44 %"))


def test_sensor_faults_are_counted_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    fault = {"name": "outlier", "run": "run0", "axis": "joint1", "evidence": "one reading deviates"}
    faults = [{**fault, "at_s": 0.1 * k, "count": 2} for k in range(3)]
    show(made(sensor_findings=[*faults, {**fault, "name": "missed_counts", "at_s": 1.0, "count": 1}]))
    assert "Sensor faults: outlier (6), missed encoder counts [missed_counts] (1)." in capsys.readouterr().out


def test_amplitudes_that_may_be_zero_are_only_named(capsys: pytest.CaptureFixture[str]) -> None:
    sizes = {"sin1_Nm": interval(2e-3), "cos1_Nm": {"value": 1e-4, "interval90": [-1e-3, 1e-3]}, "order": interval(1.0)}
    effect = {
        "name": "detent_joint1",
        "class": ["detent_joint1"],
        "probability": 0.9,
        "parameters": sizes,
        "share": 0.9,
    }
    diagnosis = made(effects=[effect], checks=[])
    for verbose in (False, True):
        show(diagnosis, verbose=verbose)
        cell = capsys.readouterr().out
        assert "sin1 2.00 mN m (1.96 to 2.04)" in cell
        assert ("distinguishable from zero: cos1" in cell) == (not verbose)
        assert ("cos1 0.100 mN m" in cell) == verbose


def test_files_are_named_in_one_line_per_folder(capsys: pytest.CaptureFixture[str]) -> None:
    show_files({"report": "out/a.html", "module": "out/m.py", "python": "out/m.py", "model": "out/other/m.xml"})
    assert capsys.readouterr().err.splitlines() == [
        "files in out: a.html (report), m.py (module, python)",
        "files in out/other: m.xml (model)",
    ]
