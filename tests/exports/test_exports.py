"""Corrected model for other programs: agreement with dpr-lab, and safe handling of text from files."""

import ast
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.effects import EFFECTS
from dpr_lab.exports import FORMATS
from dpr_lab.exports.bodies import bodies
from dpr_lab.exports.mjcf import mjcf, passive
from dpr_lab.exports.python_module import python_module
from dpr_lab.exports.sdf import sdf
from dpr_lab.exports.urdf import urdf
from dpr_lab.rig import Rig
from tests.exports.models import identified_model, model_of, run_source
from tests.thinned import thinned


def test_mjcf_contains_the_effects_that_it_can_and_lists_the_others(paper: Rig):
    effects = {
        "coulomb_joint1": {"torque_Nm": 1e-3},
        "spring_joint1": {"stiffness_Nm_per_rad": 2e-3, "cubic_Nm_per_rad3": 0.0, "constant_Nm": -1e-3},
        "latency_joint2": {"delay_s": 1e-3},
    }
    root = ElementTree.fromstring(mjcf(model_of(paper, effects), paper))
    first, second = (joint.attrib for joint in root.iter("joint"))
    assert (float(first["frictionloss"]), float(first["stiffness"])) == (1e-3, 2e-3)
    assert float(first["springref"]) == pytest.approx(np.pi - 0.5)
    assert float(second["damping"]) == pytest.approx(paper.nominal[6])
    assert "frictionloss" not in second
    assert [body.attrib["name"] for body in root.iter("body")] == ["inner", "encoder2", "outer"]
    assert next(root.iterfind("custom/text")).attrib["data"] == "Effects not in this file: latency_joint2."


def test_a_model_of_the_inner_rod_alone_is_exported_as_one_rod(paper: Rig, tmp_path: Path):
    l1, _, m1, m2, mb, c1, _, J1, _ = paper.nominal.tolist()
    a, e1 = J1 + m1 * l1**2 + mb * paper.L1**2, (m1 * l1 + mb * paper.L1) * paper.g
    both = identified_model(paper, {})
    p_over_b = m2 * paper.L1**2 / both.base["b"].value
    model = both.model_copy(update={"fitted": list(both.ratios.values()), "p_over_b": p_over_b})
    bodies = ElementTree.fromstring(mjcf(model, paper)).findall(".//body")
    assert [body.attrib["name"] for body in bodies] == ["inner"]
    inertial = bodies[0].find("inertial")
    assert inertial is not None
    mass, centre = float(inertial.attrib["mass"]), float(inertial.attrib["pos"].split()[2])
    assert mass * centre * paper.g == pytest.approx(e1)
    assert float(inertial.attrib["diaginertia"].split()[0]) + mass * centre**2 == pytest.approx(a)
    assert "outer" not in urdf(model, paper, {})
    assert "outer" not in sdf(model, paper, {})
    t = np.linspace(0.0, 1.0, 11)
    exact = solve_ivp(
        lambda _, x: (x[1], (e1 * np.sin(x[0]) - c1 * x[1]) / a), (0, 1), (1.0, 0.0), t_eval=t, rtol=1e-10
    )
    states = run_source(python_module(model, paper), tmp_path)["simulate"]((1.0, 1.0, 0.0, 0.0), t)
    assert states[:, 0] == pytest.approx(exact.y[0], abs=1e-6)


@pytest.mark.parametrize(("name", "factor"), [("d", 1.3), ("e1", 1.3), ("a", 0.8)])
def test_bodies_have_positive_inertias_and_the_motion_of_the_model_if_its_masses_do_not_fit(
    paper: Rig, name: str, factor: float
):
    model = identified_model(paper, {})
    changed = model.base[name].model_copy(update={"value": factor * model.base[name].value})
    model = model.model_copy(update={"base": {**model.base, name: changed}})
    made = bodies(model, paper, {})
    inner, outer = made.rods
    assert min(inner.mass, outer.mass, inner.inertia, outer.inertia) > 0
    tip = outer.mass + made.tip_mass
    assert inner.inertia + inner.mass * inner.centroid**2 + tip * inner.length**2 == pytest.approx(model.sizes["a"])
    assert outer.inertia + outer.mass * outer.centroid**2 == pytest.approx(model.sizes["b"])
    assert outer.mass * outer.centroid * inner.length == pytest.approx(model.sizes["d"])
    assert (inner.mass * inner.centroid + tip * inner.length) * paper.g == pytest.approx(model.sizes["e1"])


HOSTILE = [
    '"""\nimport pathlib\npathlib.Path("ran").touch()\n"""',
    "'''\nimport pathlib\npathlib.Path('ran').touch()\n'''",
    "\"\nimport pathlib; pathlib.Path('ran').touch()\n\"",
    "ends in a backslash \\",
    "{0.__class__} {rig!r} %s $model",
    '"/></mujoco><!-- ]]> --> &amp; &#0;',
    "line\nline\r\nline\ttab",
    "\x00\x1b[2J\x7f\ufffe",
    "half a pair \ud800",
    "Doppelpendel „Süd“ 双摆",
]


def tags(source: str | bytes) -> list[str]:
    return [element.tag for element in ElementTree.fromstring(source).iter()]


@pytest.fixture(scope="module")
def plain(paper: Rig) -> dict[Any, list[Any]]:
    """Structure of an export of an unmodified model: tags, and statements by effects."""
    model, both = model_of(paper, {}), ("coulomb_joint1", "coulomb_joint2")
    modules = {names: python_module(model_of(paper, {name: {} for name in names}), paper) for names in (both[:1], both)}
    statements = {names: [type(node) for node in ast.parse(source).body] for names, source in modules.items()}
    return {mjcf: tags(mjcf(model, paper)), **statements} | {made: tags(made(model, paper, {})) for made in (urdf, sdf)}


@pytest.mark.parametrize("tampered", thinned(product(HOSTILE, ("rig", "effect", "parameter")), 4))
def test_text_from_a_file_stays_data(tampered: tuple[str, str], plain, paper: Rig, tmp_path: Path, monkeypatch):
    result, where = tampered
    monkeypatch.chdir(tmp_path)
    effects = {"coulomb_joint1": {"torque_Nm": 1e-3}}
    if where != "rig":
        effects |= {result: {"size": 1.0}} if where == "effect" else {"coulomb_joint2": {"torque_Nm": 0.0, result: 1.0}}
    model = model_of(paper, effects, result if where == "rig" else "paper")

    source = python_module(model, paper)
    module = run_source(source, tmp_path)
    assert not (tmp_path / "ran").exists()
    assert module["RIG"] == model.rig.name
    assert module["LEFT_OUT"] == [name for name in effects if name not in EFFECTS]
    assert module["EFFECTS"] == {name: values for name, values in effects.items() if name in EFFECTS}
    assert [type(node) for node in ast.parse(source).body] == plain[tuple(module["EFFECTS"])]

    text = mjcf(model, paper)
    root = ElementTree.fromstring(text.encode("utf-8"))
    assert root.attrib["model"] == in_xml(model.rig.name)
    listed = next(root.iterfind("custom/text")).attrib["data"]
    assert in_xml(result) in listed if where == "effect" else "<" not in listed
    for other in (urdf, sdf):
        assert tags(other(model, paper, {result: result}).encode("utf-8")) == plain[other]
    run_source(passive(model, paper), tmp_path)
    assert not (tmp_path / "ran").exists()
    assert [element.tag for element in root.iter()] == plain[mjcf]


@pytest.mark.slow
def test_every_format_is_written(paper: Rig, tmp_path: Path):
    model = model_of(paper, {})
    for made in FORMATS.values():
        files = made.written(model, paper)
        assert made.main in files
        assert all(Path(file).name == file and content for file, content in files.items())


def test_every_format_is_in_the_help_and_on_its_page() -> None:
    root = Path(__file__).parents[2]
    shown = (root / "dpr_lab/cli/export.py").read_text(encoding="utf-8")
    page = (root / "docs/exports.md").read_text(encoding="utf-8")
    formats = f'help="Formats, separated by commas: {", ".join(FORMATS)}. Default'
    is_complete = formats in shown
    assert is_complete, f"the help of --to in dpr_lab/cli/export.py must begin with {formats!r}"
    missing = [name for name in FORMATS if f"| `{name}` |" not in page]
    assert missing == [], "add a row to the first table of docs/exports.md"


def in_xml(original: str) -> str:
    """Characters of a text that XML can contain."""
    gone = {"\x00", "\x1b", "\ufffe", "\ud800"}
    return "".join("\N{REPLACEMENT CHARACTER}" if character in gone else character for character in original)
