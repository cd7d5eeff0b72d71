"""`dpr-lab check`: units, refusals, the table of probabilities before and after, and commands that can be copied."""

import json
from pathlib import Path

from tests.a_diagnosis import CLOCK, made


def test_the_command_asks_for_the_unit_and_shows_before_and_after(tmp_path: Path, cli) -> None:
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps(made().to_json()))
    check = ("check", file, "1-abcd")
    refused = [
        (("--value", "0.5", "--std", "0.01"), 3, "the unit is missing. Accepted units: %, ppm, 1. Example: 0.1 %"),
        (("--value", "0.5 mN m", "--std", "0.01"), 3, "'mN m' is not a unit of this quantity"),
        (("--value", "fast", "--std", "1 %"), 3, "'fast' is not a number with its unit"),
        (("--value", "0,5 %", "--std", "1 %"), 3, "write the number with a decimal point"),
        (("--value", "nan %", "--std", "1 %"), 3, "must be a finite number, not nan"),
        (("--value", "1e308 %", "--std", "1 %"), 3, "is impossible for the rate error"),
        (("--value", "1e999 %", "--std", "1 %"), 3, "must be a finite number, not inf"),
        (("--value", "0.5 %", "--std", "0"), 3, "uncertainty must be above 0"),
        (("--value", "0.5 %"), 3, "is a measurement and lacks --std: give its result, --value"),
        (("--value", "50 %", "--std", "1e-9"), 3, "repeat the command with --force"),
    ]
    for words, code, message in refused:
        done = cli(*check, *words)
        assert (done.code, "Traceback" in done.err) == (code, False), (words, done.err)
        assert message in " ".join(done.err.split()), (words, done.err)
    done = cli(*check, "--value", "5050ppm", "--std", "100")
    assert done.code == 0, done.err
    assert "rate error of the device's clock" in done.out
    assert "Bayes factor" in done.out
    forced = cli(*check, "--value", "50 %", "--std", "1e-9", "--force", "--json").json
    assert forced["checks_done"][0]["after"]["unexplained"] > 0.99
    assert forced["checks_done"][0]["value"] == 0.5
    assert forced["checks"][0]["quantity"]["unit"] == "m"


def test_the_advice_after_a_check_can_be_pasted(tmp_path: Path, cli) -> None:
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps(made().to_json()))
    done = cli("check", file, "1-abcd", "--value", "0 %", "--std", "0.001 %")
    assert f"--without {CLOCK} to fit it" in " ".join(done.out.split())


def test_checks_without_further_information_are_only_listed(tmp_path: Path, cli) -> None:
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps(made().to_json()))
    done = cli("check", file, "1-abcd", "--value", "0.5 %", "--std", "0.001 %")
    assert "Remaining checks (2-abcd): none of them is expected to add information." in " ".join(done.out.split())
