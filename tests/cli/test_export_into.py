"""`dpr-lab export --into`: from a simulator model to a rig file, an identified model and back into the file."""

from pathlib import Path

import pytest

from dpr_lab.exports import FORMATS
from dpr_lab.rig import Rig
from tests.exports.models import model_of

pytestmark = pytest.mark.slow


def test_an_identified_model_goes_into_the_file_of_the_user(cli, model: Path, paper: Rig, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    text = FORMATS["mjcf"].written(model_of(paper, {}), paper)["corrected_model.xml"]
    assert isinstance(text, str)
    (tmp_path / "mine.xml").write_text(text.replace("<worldbody>", "<!-- mine --><worldbody>"), encoding="utf-8")
    assert cli("rig", "from", "mine.xml", "--out", "rig.toml", cwd=tmp_path).code == 0
    words = ("export", model, "--rig", "rig.toml", "--into", "mine.xml", "--out", "out")
    done = cli(*words, "--json", cwd=tmp_path)
    assert done.code == 0, done.err
    damping = [change for change in done.json["changes"] if change["attribute"] == "damping"]
    assert [change["element"] for change in damping] == ["joint joint1", "joint joint2"]
    assert done.json["lost"] == {}
    assert "<!-- mine -->" in (tmp_path / "out/mine.xml").read_text(encoding="utf-8")
    assert (tmp_path / "out/mine.xml.diff").read_text(encoding="utf-8") == done.json["diff"]
    shown = cli(*words, cwd=tmp_path)
    assert "-      <joint" in shown.out.replace("  -", "-")
    assert "Changed in mine.xml" in shown.out
    again = cli(*words[:-1], ".", cwd=tmp_path)
    assert (again.code, "is not overwritten" in again.err) == (3, True)


def test_another_format_is_refused(cli, model: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.xml").write_text("<scene/>", encoding="utf-8")
    done = cli("export", model, "--rig", "paper", "--into", "mine.xml", cwd=tmp_path)
    assert (done.code, "its root element is <scene>" in done.err) == (3, True)
