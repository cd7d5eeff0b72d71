import pytest

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS
from dpr_lab.exports.corrected import significant_values
from dpr_lab.gap.result.causes import EffectSize, NamedEffect
from dpr_lab.gap.result.gap_size import Gap
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.gap.result.saved import Interval
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.report.gap.sizes import scale_note, sizes_cell, true_sizes_cell
from tests.report.test_gap_report import diagnosis as diagnosis

NOT_MEASURED = Scale(b=0.00541, interval90=(0.00487, 0.00623), fixed_by="bound")
TORQUE = EffectSize(
    value=0.00230,
    interval90=(0.00228, 0.00232),
    ratio=0.425,
    ratio_unit="1/s^2",
    ratio_interval90=(0.421, 0.429),
    interval90_with_scale=(0.00207, 0.00265),
)


def named(size: EffectSize = TORQUE) -> NamedEffect:
    return NamedEffect.model_validate(
        {"name": "coulomb_joint1", "class": ["coulomb_joint1"], "probability": 0.9, "share": 0.5}
        | {"parameters": {"torque_Nm": size}}
    )


def test_where_only_ratios_are_identified_the_ratio_stands_before_the_absolute_size(diagnosis) -> None:
    result = diagnosis(scale=NOT_MEASURED, effects=[named()])
    cell = sizes_cell(result, result.effects[0])
    assert cell == (
        "torque / b = 0.4250 1/s² (0.4210 to 0.4290); assuming b = 0.00541 kg m² (not measured):"
        " torque 2.30 mN m (2.07 to 2.65)"
    )
    assert "0.00487 to 0.00623" in scale_note(result)


def test_a_true_size_is_a_ratio_too_where_only_ratios_are_identified(diagnosis) -> None:
    assumed = {"scale": NOT_MEASURED, "scale_b": NOT_MEASURED.b}
    cell = true_sizes_cell(diagnosis(**assumed), "coulomb_joint1", {"torque_Nm": 0.0024})
    assert cell == "torque / b = 0.444 1/s²; assuming b = 0.00541 kg m² (not measured): torque 2.40 mN m"
    measured = diagnosis(**assumed | {"scale": NOT_MEASURED.model_copy(update={"fixed_by": "measured"})})
    assert true_sizes_cell(measured, "coulomb_joint1", {"torque_Nm": 0.0024}) == "torque 2.40 mN m"
    offset = true_sizes_cell(diagnosis(**assumed), "encoder_offset_joint1", {"offset_rad": 0.01})
    assert offset == "offset 10.0 mrad"


def test_a_measured_scale_gives_an_absolute_size_with_the_uncertainty_of_the_scale(diagnosis) -> None:
    result = diagnosis(scale=NOT_MEASURED.model_copy(update={"fixed_by": "measured"}), effects=[named()])
    assert sizes_cell(result, result.effects[0]) == "torque 2.30 mN m (2.07 to 2.65)"


def test_an_angle_has_no_ratio_and_a_diagnosis_of_an_older_version_keeps_its_interval(diagnosis) -> None:
    old = EffectSize(value=0.0023, interval90=(0.0022, 0.0024))
    result = diagnosis(effects=[named(old)])
    assert sizes_cell(result, result.effects[0]) == "torque 2.30 mN m (2.20 to 2.40)"
    assert scale_note(result) == ""


def test_the_missing_torque_in_a_file_of_version_0_2_is_ignored(diagnosis) -> None:
    gap = diagnosis().gap
    assert Gap.model_validate({**gap.model_dump(), "before_Nm": {"joint1": 1e-3}}) == gap


def test_parameters_held_at_zero_stand_last_in_one_group(diagnosis) -> None:
    zero = EffectSize(value=0.0, interval90=(0.0, 0.0))
    rise = EffectSize(value=0.0005, interval90=(0.0003, 0.0007))
    parameters = {"forward_Nm": zero, "rise1_Nm": zero, "rise2_Nm": rise}
    curve = NamedEffect.model_validate(
        {"name": "friction_curve_joint1", "class": [], "probability": 0.9, "share": 0.5, "parameters": parameters}
    )
    cell = sizes_cell(diagnosis(effects=[curve]), curve)
    assert cell == "rise (0.3 to 1 rad/s) 0.500 mN m (0.300 to 0.700); at zero: forward, rise (0 to 0.3 rad/s)"


@pytest.mark.parametrize(("unit", "text"), [("1/kg", "torque · b"), ("N m", "torque / b")])
def test_a_ratio_shows_whether_b_divides_or_multiplies(diagnosis, unit: str, text: str) -> None:
    size = TORQUE.model_copy(update={"ratio_unit": "m^2" if unit == "1/kg" else "1/s^2"})
    result = diagnosis(scale=NOT_MEASURED, effects=[named(size)])
    assert sizes_cell(result, result.effects[0]).startswith(text)


def test_a_negative_drift_of_friction_is_put_into_words(diagnosis) -> None:
    drift = named().model_copy(
        update={
            "name": "friction_drift_joint1",
            "parameters": {"rate_Nm_per_rad": TORQUE.model_copy(update={"value": -1e-5})},
        }
    )
    result = diagnosis(scale=NOT_MEASURED, effects=[drift])
    assert "viscous friction decreases during the swing" in sizes_cell(result, drift)


def test_a_negative_drift_of_friction_has_words(diagnosis) -> None:
    (parameter,) = EFFECTS["friction_drift_joint2"].parameters
    cells = []
    for value in (-0.02, 0.02):
        size = EffectSize(value=value, interval90=(value - 0.005, value + 0.005))
        drift = {"name": "friction_drift_joint2", "class": ["friction_drift_joint2"], "probability": 0.9, "share": 0.5}
        effect = NamedEffect.model_validate(drift | {"parameters": {parameter.name: size}})
        cells.append(sizes_cell(diagnosis(effects=[effect]), effect))
    assert cells[0].endswith("viscous friction decreases during the swing, for example because grease warms up")
    assert "grease" not in cells[1]


def test_an_event_has_a_size_and_no_interval_of_its_joint_or_instant(diagnosis) -> None:
    def chosen(value: float) -> EffectSize:
        return EffectSize(value=value, interval90=(value, value), interval90_with_scale=(value, value))

    counts = EffectSize(value=-3.1, interval90=(-3.3, -2.9), interval90_with_scale=(-3.3, -2.9))
    parameters = {"counts": counts, "joint": chosen(1.0), "run": chosen(0.0), "time_s": chosen(2.43306)}
    event = NamedEffect.model_validate(
        {
            "name": "missed_counts",
            "class": ["missed_counts"],
            "probability": 0.9,
            "share": 0.5,
            "parameters": parameters,
        }
    )
    result = diagnosis(effects=[event])
    assert sizes_cell(result, event) == "counts -3.10 counts (-3.30 to -2.90); joint 1; time 2.43 s"


def test_the_sizes_in_the_models_are_stated_if_an_omitted_amplitude_changes_them(diagnosis) -> None:
    """The models contain a linear spring; without the cubic term its stiffness is larger."""
    name, stiffness, cubic = "spring_joint1", "stiffness_Nm_per_rad", "cubic_Nm_per_rad3"
    fitted = {stiffness: 0.0666, cubic: 0.0041}
    sizes = {
        stiffness: EffectSize(value=0.0666, interval90=(0.05, 0.08)),
        cubic: EffectSize(value=0.0041, interval90=(-0.001, 0.009)),
    }
    spring = named().model_copy(update={"name": name, "parameters": sizes})
    posterior = PosteriorComponent(
        probability=1.0,
        ratios={},
        effects={name: fitted},
        free=[f"{name}.{stiffness}", f"{name}.{cubic}"],
        covariance=[[1e-4, -3e-5], [-3e-5, 1e-5]],
    )
    ratios = {ratio: Interval(value=1.0, interval90=(0.9, 1.1)) for ratio in RATIOS}
    result = diagnosis(effects=[spring], model_effects={name: fitted}, posterior=[posterior], ratios=ratios)
    stated = "stiffness 78.9 mN m/rad"
    assert significant_values(result)[1][name] == {stiffness: pytest.approx(0.0789), cubic: 0.0}
    for brief in (True, False):
        cell = sizes_cell(result, spring, brief=brief)
        assert cell.startswith("stiffness 66.6 mN m/rad (50.0 to 80.0); ")
        assert cell.endswith(f"in the exported models: {stated}")
    alone = spring.model_copy(update={"parameters": {stiffness: sizes[stiffness]}})
    assert "models" not in sizes_cell(result.model_copy(update={"effects": [alone]}), alone)
