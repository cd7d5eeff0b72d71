"""`dpr-lab accept` on two releases of a simulated rig: exit codes, JSON and refusals."""

import json
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

LIMITS = {
    "pass": (0, '[effects.latency_joint2]\ndelay_s = { max = 0.01, unit = "s" }'),
    "fail": (1, '[ratios]\n"c2/b" = { min = 100.0, unit = "1/s" }'),
    "not decidable": (9, '[effects.latency_joint2]\ndelay_s = { max = 1e-9, unit = "s" }'),
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory, cli) -> list[Path]:
    out = tmp_path_factory.mktemp("accepted")
    poses = ("--pose", "X1", "--pose", "X3", "--duration", "2")
    done = cli("capture", "--rig", "paper", "--link", "sim://?clock=fast&seed=1", *poses, "--out", out)
    assert done.code == 0, done.err
    return sorted(out.glob("*.mcap"))


@pytest.fixture(scope="module")
def accepted(runs: list[Path], tmp_path_factory: pytest.TempPathFactory, cli) -> tuple[Path, str]:
    """Output and folder of `accept` with one limit that passes and one that fails."""
    folder = tmp_path_factory.mktemp("limits")
    (folder / "limits.toml").write_text(f"{LIMITS['pass'][1]}\n{LIMITS['fail'][1]}")
    words = ("--rig", "paper", "--limits", folder / "limits.toml", "--out", folder / "out")
    done = cli("accept", *runs, *words)
    assert done.code == 1, done.err
    return folder / "out", done.out


@pytest.mark.parametrize("answer", LIMITS)
def test_each_answer_has_its_exit_code(
    runs: list[Path], accepted: tuple[Path, str], tmp_path: Path, cli, answer: str
) -> None:
    code, text = LIMITS[answer]
    file = tmp_path / "limits.toml"
    file.write_text(text)
    done = cli("accept", *runs, "--rig", "paper", "--limits", file, "--diagnosis", accepted[0], "--json")
    assert done.code == code, done.err
    assert done.json["answer"] == answer
    assert [limit["answer"] for limit in done.json["limits"]] == [answer]


def test_the_report_shows_each_limit_with_its_answer(runs: list[Path], accepted: tuple[Path, str], cli) -> None:
    out, printed = accepted
    file = out.with_name("limits.toml")
    page = (out / "diagnosis.html").read_text()
    section = page[page.index('id="acceptance"') :].split("</details>")[0]
    assert "fail: 1 of 2 limits pass" in section
    for quantity in ("latency_joint2.delay_s", "c2/b"):
        assert quantity in section
        assert quantity in printed
    answers = {limit["quantity"]: limit["answer"] for limit in json.loads((out / "accept.json").read_text())["limits"]}
    assert answers == {"latency_joint2.delay_s": "pass", "c2/b": "fail"}
    assert json.loads((out / "diagnosis.json").read_text())["files"]["report"] == str(out / "diagnosis.html")
    other = cli("accept", *runs, "--rig", "multiarm", "--limits", file, "--diagnosis", out)
    assert other.code == 3
    fewer = cli("accept", *runs[:1], "--rig", "paper", "--limits", file, "--diagnosis", out)
    assert fewer.code == 3
    assert "is a diagnosis of" in fewer.err


def test_a_limits_file_that_is_not_there_is_refused_before_the_work(runs: list[Path], tmp_path: Path, cli) -> None:
    done = cli("accept", *runs, "--rig", "paper", "--limits", tmp_path / "none.toml")
    assert done.code == 3
    assert "none.toml: cannot be read" in done.err
    assert "Traceback" not in done.err
