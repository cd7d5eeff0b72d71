"""Values of a rig file lie within possible limits; otherwise the message names file, key and value."""

import pytest

from dpr_lab.configs import BUILTIN
from dpr_lab.errors import ConfigError
from dpr_lab.rig import load_rig, parse_rig

PAPER = (BUILTIN / "rigs" / "paper.toml").read_text(encoding="utf-8")


def changed(old: str, new: str) -> str:
    assert old in PAPER
    return PAPER.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("L1 = 0.4", "L1 = 172.7", "rig.L1 = 172.7: is too large for a length in m; 172.7 mm is 0.1727 m"),
        ("L1 = 0.4", "L1 = 0,4", "(at line 6, column 7): L1 = 0,4; write numbers with a decimal point"),
        ("theta1 = 0.1", "theta1 = 160", "is too large for an angle in rad; 160 degrees are 2.793 rad"),
        ("g = 9.81", "g = true", "rig.g = True"),
        ("g = 9.81", 'g = "9.81"', "rig.g = '9.81'"),
        ("g = 9.81", "g = 1e308", "rig.g = 1e+308"),
        ("g = 9.81", f"g = {'9' * 5000}", "is not valid TOML"),
        ("16384, 16384, 16384", "16384, 1000000000000, 16384", "encoders.counts_per_rev, entry 2 ="),
        ("theta1 = 0.1", "theta1 = 1e300", "theta1 = 1e+300"),
    ],
)
def test_values_that_no_bench_has_are_refused(old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        parse_rig(changed(old, new))
    assert message in str(error.value)
    assert len(str(error.value)) < 400


def test_a_file_of_windows_may_begin_with_a_byte_order_mark(tmp_path) -> None:
    (tmp_path / "rig.toml").write_text(PAPER, encoding="utf-8-sig")
    assert load_rig(tmp_path / "rig.toml").name == "paper"
    (tmp_path / "rig.toml").write_text(PAPER, encoding="utf-16")
    with pytest.raises(ConfigError, match="save it with this encoding"):
        load_rig(tmp_path / "rig.toml")


def test_a_folder_is_not_a_rig_file(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="is a folder: give a file in this folder"):
        load_rig(tmp_path)
    (tmp_path / "paper").mkdir()  # such as a folder of runs
    monkeypatch.chdir(tmp_path)
    assert load_rig("paper").name == "paper"


def test_text_and_file_are_the_same_rig(tmp_path) -> None:
    (tmp_path / "rig.toml").write_text(PAPER, encoding="utf-8")
    assert parse_rig(PAPER).model_dump() == load_rig(tmp_path / "rig.toml").model_dump()
    assert parse_rig(PAPER).sha256 == load_rig(tmp_path / "rig.toml").sha256
