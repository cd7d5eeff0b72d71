"""`dpr-lab export --ensemble`: a folder for each sampled model, and one file with all of them."""

import json
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow


def test_an_ensemble_is_a_folder_for_each_model_and_one_file(cli, model: Path, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    words = ("export", model, "--rig", "paper", "--ensemble", 3, "--seed", 1, "--out", "out")
    done = cli(*words, "--json", cwd=tmp_path)
    assert done.code == 0, done.err
    assert done.json["sets"] == {"none": 3}
    assert done.json["expected_coverage"] == 0.5
    document = json.loads((tmp_path / "out" / "ensemble.json").read_text(encoding="utf-8"))
    assert document["expected_coverage"] == 0.5
    assert len({member["ratios"]["a/b"] for member in document["models"]}) == 3
    for number in range(3):
        mujoco.MjModel.from_xml_path(str(tmp_path / "out" / f"00{number}" / "corrected_model.xml"))
    printed = " ".join(cli(*words, cwd=tmp_path).out.split())
    assert "The bands of 3 models contain on average 50 % of the readings of another recording." in printed
    assert "For bands that contain 90 %, sample 19 models" in printed
    assert cli(*words, "--into", "x.xml", cwd=tmp_path).code == 2
