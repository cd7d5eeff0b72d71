"""Noise in the corrected model of a diagnosis, compared with the noise that was added to a simulated recording."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.dynamics.base import RATIOS, whole_parameters
from dpr_lab.errors import ConfigError, RunError
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.exports.corrected import corrected_arm_model, corrected_model
from dpr_lab.fitting.estimate import unknown_ratios
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.gap.result.gap_size import Gap
from dpr_lab.gap.result.saved import Interval
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.problem import reading_std
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import Rig, load_rig
from dpr_lab.rig_tables import AddedMass, ArmMode
from dpr_lab.run import Run
from tests.one_cause import one_cause

NOISE = np.array([3e-3, 2e-3, 1e-3])
"""Noise of a reading of joints 0, 1 and 2, rad, at 1 kHz; a diagnosis averages five readings."""
AFTER = {"joint0": 4e-3, "joint1": 3e-3, "joint2": 2e-3}


def recorded(rig: Rig, mode: ArmMode) -> Run:
    t = np.arange(4000) / 1000.0
    joints = 0.3 * np.sin(np.outer(t, (3.0, 5.0, 7.0))) + NOISE * np.random.default_rng(4).standard_normal((4000, 3))
    joints[:, 1:] = joints[:, 1:] @ rig.encoders.joint_angles.to_rods_matrix.T
    return Run("swing", t, joints, None, None, rig.name, rig.sha256, 1000.0, arm_mode=mode, mounting=rig.rods.mounting)


def diagnosed(rig: Rig) -> Diagnosis:
    unknown = unknown_ratios(whole_parameters(rig.nominal, rig.L1, rig.g))
    gap = Gap.model_construct(floor_rad={name: 1e-4 for name in AFTER}, after_rad=AFTER)
    five = {name: Interval(value=v, interval90=(v, v)) for name, v in zip(RATIOS, unknown.tolist(), strict=False)}
    return Diagnosis.model_construct(
        ratios=five, fitted=[], determined=five, gap=gap, scale_b=float(unknown[5]), p_over_b=float(unknown[6]),
        scale=None, ratio_covariance=np.zeros((5, 5)).tolist(), determined_covariance=np.zeros((5, 5)).tolist(),
        segments=1, chi2_per_dof=1.0, verdict="no_gap", seconds=0.0, posterior=[], effects=[], model_effects={},
    )  # fmt: skip


def test_a_moving_arm_has_the_noise_of_a_single_reading() -> None:
    rig = load_rig("furuta").with_rods("both")
    run, diagnosis = recorded(rig, "free"), diagnosed(rig)
    fit = corrected_arm_model(diagnosis, diagnosis.unknowns, {}, [run], rig).fit
    assert list(fit.noise_rad.values()) == pytest.approx(NOISE, rel=0.1)
    assert list(fit.noise_rad.values()) == pytest.approx(reading_std(run, rig))  # as in an identification
    assert list(fit.rms_rad.values()) == pytest.approx(np.hypot(NOISE, list(AFTER.values())), rel=0.1)


def test_a_clamped_arm_has_the_noise_of_a_single_reading(paper: Rig) -> None:
    diagnosis = diagnosed(paper)
    gap = Gap.model_construct(floor_rad={}, after_rad={"joint1": 0.0, "joint2": 0.0})
    fit = corrected_model(diagnosis.model_copy(update={"gap": gap}), [recorded(paper, "clamped")], paper).fit
    relative = paper.encoders.joint2 == "relative"
    expected = {"theta1": NOISE[1], "theta2": np.hypot(NOISE[1] * relative, NOISE[2])}
    assert fit.noise_rad == pytest.approx(expected, rel=0.1)


def test_a_diagnosis_of_another_rig_file_has_no_corrected_model(paper: Rig) -> None:
    evidence = Evidence.model_construct(rig="paper", rig_sha256="1", rig_values_sha256="2", recordings=[])
    diagnosis = one_cause().model_copy(update={"evidence": evidence})
    run = recorded(paper, "clamped")
    with pytest.raises(ConfigError, match="the diagnosis was made with another file of rig paper"):
        corrected_model(diagnosis, [replace(run, name=name) for name in ("X1", "X2", "X3")], paper)
    with pytest.raises(RunError, match="is a diagnosis of X1, X2 and X3, not of swing"):
        corrected_model(diagnosis, [run], paper)


def test_absolute_values_of_a_clamped_arm_have_the_inertia_that_the_recordings_determine(paper: Rig) -> None:
    diagnosis = diagnosed(paper)
    scale = Scale(
        b=diagnosis.scale_b, interval90=(0.999 * diagnosis.scale_b, 1.001 * diagnosis.scale_b), fixed_by="data"
    )
    gap = Gap.model_construct(floor_rad={}, after_rad={"joint1": 0.0, "joint2": 0.0})
    loaded = replace(recorded(paper, "clamped"), added_mass=AddedMass(rod="outer", mass=0.05, position=0.3))
    model = corrected_model(diagnosis.model_copy(update={"gap": gap, "scale": scale}), [loaded], paper)
    assert isinstance(model, Model)
    for name, value in model.base.items():
        assert value.fixed_by == "data", name
        assert value.interval90 == pytest.approx((0.999 * value.value, 1.001 * value.value), rel=1e-5)
    assert {name for name, value in model.parameters.items() if value.fixed_by == "data"} == {"c1", "c2"}


def test_a_ratio_with_a_wide_interval_has_no_smaller_standard_deviation(paper: Rig) -> None:
    """With a clamped elbow, the covariance of the fit treats ratios of the rig file as known."""
    diagnosis = diagnosed(paper)
    wide = diagnosis.ratios | {"d/b": Interval(value=1.5, interval90=(1.3, 1.7))}
    gap = Gap.model_construct(floor_rad={}, after_rad={"joint1": 0.0, "joint2": 0.0})
    changes = {"gap": gap, "ratios": wide}
    model = corrected_model(diagnosis.model_copy(update=changes), [recorded(paper, "clamped")], paper)
    assert model.ratios["d/b"].std == pytest.approx(0.2 / NORMAL_Q90)


def test_a_weighed_outer_rod_does_not_determine_the_scale_of_the_inner_rod_alone() -> None:
    """A diagnosis of an older version does not state the scale."""
    table = load_rig("furuta").with_rods("both").model_dump(exclude_none=True)
    for name in ("l2", "m2", "J2"):
        nominal = table["parameters"][name]["nominal"]
        table["parameters"][name] = {"nominal": nominal, "measured": nominal, "std": 0.01 * nominal}
    rig = Rig.model_validate(table).with_rods("inner")
    diagnosis = diagnosed(rig).model_copy(update={"determined": {}, "determined_covariance": []})
    model = corrected_arm_model(diagnosis, diagnosis.unknowns, {}, [recorded(rig, "free")], rig)
    assert model.scale_sentence.startswith("Only the ratios of masses, inertias and torques to a")
