"""A model file is read by names: the order of keys has no effect, and missing or unknown keys are refused."""

import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.identification.model import Model, load_model
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.identification.moving_arm.model import load_model as load_any_model
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.identification.scaling.values import ratios_alone
from dpr_lab.report.data_frame import to_dataframe
from dpr_lab.report.tables import parameter_table
from dpr_lab.rig import NO_ENCODER

(MODEL,) = (Path(__file__).parents[1]).rglob("model.json")


def written(path: Path, table: object, **options: Any) -> Path:
    path.write_text(json.dumps(table, **options), encoding="utf-8")
    return path


@pytest.fixture
def table() -> dict[str, Any]:
    return json.loads(MODEL.read_text(encoding="utf-8"))


def test_a_file_with_sorted_keys_is_the_same_model(table, tmp_path: Path) -> None:
    as_it_was, in_order = load_model(MODEL), load_model(written(tmp_path / "m.json", table, sort_keys=True))
    assert in_order == as_it_was
    assert in_order.ratio_values.tolist() == as_it_was.ratio_values.tolist()
    assert list(in_order.parameters) == list(as_it_was.parameters)
    assert list(in_order.base) == list(as_it_was.base)
    assert in_order.unknowns.tolist() == as_it_was.unknowns.tolist()


@pytest.mark.parametrize(
    ("part", "key"),
    [("ratios", "d/b"), ("parameters", "m1"), ("base", "b"), ("cramer_rao_std", "a/b")],
)
@pytest.mark.parametrize("change", ["missing", "unknown"])
def test_a_missing_or_unknown_name_is_refused(table, tmp_path: Path, part: str, key: str, change: str) -> None:
    if change == "missing":
        del table[part][key]
    else:
        table[part]["x"] = table[part][key]
    with pytest.raises(RunError, match=f"{part}.*{change}: {key if change == 'missing' else 'x'}"):
        load_model(written(tmp_path / "m.json", table))


@pytest.mark.parametrize(
    "content",
    [b"\xff\xfe", b"[" * 100_000, b'{"a": ' + b"9" * 5000 + b"}", b"[]", b"3", b"null", b""],
    ids=["coding", "deep", "digits", "list", "number", "null", "empty"],
)
def test_an_invalid_model_file_is_refused_with_a_sentence(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "m.json").write_bytes(content)
    with pytest.raises(RunError, match=r"m\.json: is not a model"):
        load_model(tmp_path / "m.json")


def test_an_effect_of_a_newer_version_is_refused_by_its_name(table, tmp_path: Path) -> None:
    table["effects"] = {"warp": {"x": 1.0}}
    with pytest.raises(RunError, match=r"m\.json: effects\.warp: unknown effect or parameters \(x\): update dpr-lab"):
        load_model(written(tmp_path / "m.json", table))


def test_a_model_is_read_from_the_folder_of_a_diagnosis(table, tmp_path: Path) -> None:
    written(tmp_path / "model.json", table)
    assert load_model(tmp_path) == load_any_model(tmp_path) == load_model(MODEL)


def test_a_model_of_a_moving_arm_is_refused_where_the_arm_must_be_clamped(table, tmp_path: Path) -> None:
    empty = {"mounted": "inner", "input": "", "scale": "a", "unknowns": [], "scale_sentence": "", "swing": [0.0] * 12}
    b = {"value": 0.005, "std": 0.001, "interval90": [0.004, 0.006], "fixed_by": "bound"}
    empty |= {"ratios": {}, "absolute": {"a": b}, "undetermined": {}, "covariance": [], "runs": []}
    fit = {"rms_rad": {}, "noise_rad": {}, "segments": 1, "segment_s": 1.0, "chi2_per_dof": 1.0, "converged": True}
    file = written(tmp_path / "m.json", {"kind": "moving_arm", "rig": table["rig"], "fit": fit} | empty)
    model = load_any_model(file)
    assert isinstance(model, MovingArmModel)
    assert repr(model).splitlines()[-1].split() == ["a", "0.005", "0.001", "only", "its", "bounds"]
    with pytest.raises(RunError, match="is a model of a rig with a moving arm"):
        load_model(file)


@pytest.mark.parametrize("effects", [{"gremlins": {}}, {"coulomb_joint1": {"torque": 1.0}}])
def test_an_unknown_effect_is_refused(table, tmp_path: Path, effects) -> None:
    with pytest.raises(RunError, match=f"effects.{next(iter(effects))}"):
        load_model(written(tmp_path / "m.json", table | {"effects": effects}))


def test_an_invalid_covariance_is_refused(table, tmp_path: Path) -> None:
    table["covariance"]["matrix"][0].append(1.0)
    with pytest.raises(RunError, match="square matrix"):
        load_model(written(tmp_path / "m.json", table))


def test_an_export_gets_the_ratios_of_the_recordings_and_not_those_that_the_bounds_pull_away() -> None:
    model = load_model(MODEL)
    pulled = model.with_ratios(np.multiply(model.ratio_values, (1.0, 1.0, 1.0, 0.97, 1.02)))
    base = {name: value.value for name, value in pulled.scaled_ratios().base.items()}
    assert base["b"] == model.base["b"].value
    of_ratios = [base[name] / base["b"] for name in ("a", "d", "e1", "c1", "c2")]
    assert of_ratios == pytest.approx(pulled.ratio_values, rel=1e-12)
    assert base["c1"] == pytest.approx(0.97 * model.base["c1"].value, rel=1e-6)


@pytest.mark.parametrize("inertia", ["a", "b"])
def test_a_model_of_the_inner_rod_alone_states_the_same_a_and_e1_everywhere(
    tmp_path: Path, inertia: Literal["a", "b"]
) -> None:
    both = load_model(MODEL)
    assert both.alone == {}
    assert both.mounted == both.parameters
    five, p = [*both.ratios.values()], 3.0
    ratios = ratios_alone(five, p, both.rig.g / both.rig.L1)
    scale = Scale(b=0.005, interval90=(0.004, 0.006), fixed_by="bound")
    share = five[0].value - p
    changes = {"fitted": five, "p_over_b": p, "ratios": ratios, "cramer_rao_std": {}}
    scale = scale.as_inertia("a", share) if inertia == "a" else scale  # older files contain b
    model = both.model_copy(update=changes | {"scale": scale})
    model.save(str(tmp_path / "model.json"))  # a script gives a text, as to `load_model`
    assert load_model(tmp_path) == model
    frame, of_file = to_dataframe(model)["value"], json.loads((tmp_path / "model.json").read_text())["alone"]
    assert set(frame.index) == {"e1/a", "c1/a", "a", "e1", "c1", "l1", "m1", "mb", "J1"}
    assert frame["a"] == of_file["a"]["value"] == pytest.approx(0.005 * share)
    assert frame["e1"] == of_file["e1"]["value"] == pytest.approx(frame["e1/a"] * frame["a"])
    assert f"assume a = {frame['a']:.4g} kg m^2" in model.scale_sentence
    assert of_file["a"]["interval90"] == pytest.approx([0.004 * share, 0.006 * share])
    assert {line.split()[0] for line in repr(model).splitlines()[2:]} == set(frame.index)
    assert {row[0] for row in parameter_table(model).rows} == {"l1", "m1", "mb", "c1", "J1"}
    without = model.parameters | {"mb": model.parameters["mb"].model_copy(update={"value": NO_ENCODER["nominal"]})}
    assert "mb" not in model.model_copy(update={"parameters": without}).mounted


def test_every_key_of_a_model_file_is_documented() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "files.md").read_text(encoding="utf-8")
    section = page.split("## Models")[1].split("## ")[0]
    assert [key for key in (*Model.model_fields, *Model.model_computed_fields) if f"`{key}`" not in section] == []
