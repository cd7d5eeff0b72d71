"""Verdicts: hints of a wrong description, "no gap" only if a gap would be visible, order of equivalent effects."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dpr_lab.effects import EFFECTS, effect_params, plausibility
from dpr_lab.errors import RunError
from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.conclusion import description as description_module
from dpr_lab.gap.conclusion.description import rising_energy, unexplained_energy
from dpr_lab.gap.conclusion.sentence import _in_noise
from dpr_lab.gap.conclusion.verdict import listed_causes
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.state import Description
from dpr_lab.report.plain import as_json
from dpr_lab.report.words import in_words
from dpr_lab.rig import Rig, load_rig, parse_rig
from dpr_lab.run import Run
from dpr_lab.setup import ArmMotion
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.workflows.diagnose import failures
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure
from sim_device.plant.config import load_plant
from sim_device.trials.driven import driven_runs
from sim_device.trials.offline_recorder import record
from tests import bench_rigs, one_rod
from tests.background_rigs import recordings
from tests.storage.mutated_tables import mutated_tables
from tests.thinned import candidates

SOME = {
    name: EFFECTS[name] for name in ("coulomb_joint1", "torque_scale_joint2", "spring_joint2", "rotor_inertia_joint2")
}
SAMPLES = Path(__file__).parents[2] / "configs" / "tables"
TWINS = {name: EFFECTS[name] for name in ("wrong_length_L1", "clock_rate")}


@pytest.fixture(scope="module")
def swings(recorded: Callable[..., list[Run]]) -> list[Run]:
    return recorded({}, duration=2.0)


@pytest.fixture(scope="module")
def driven(paper: Rig) -> list[Run]:
    slower = paper.model_copy(update={"link": paper.link.model_copy(update={"rate_hz": 250})})
    return driven_runs(slower, 0, duration=1.5)[1]


def with_signs(runs: list[Run], signs: tuple[int, int]) -> list[Run]:
    return [replace(run, torques=np.asarray(run.torques) * signs, commanded=None) for run in runs]


@pytest.mark.slow
def test_torques_that_were_left_out_are_a_hint_and_no_cause_is_named(
    driven: list[Run], paper: Rig, few_readings: Callable[[str], None]
) -> None:
    few_readings("torque")
    runs = [replace(run, torques=None, commanded=None, torque_kind="") for run in driven]
    without_torques = diagnose(runs, paper, library=SOME)
    assert without_torques.verdict == "unexplained"
    assert "--torque none" in without_torques.sentence
    assert without_torques.effects == without_torques.rivals == []
    assert without_torques.probabilities["unexplained"] > 0.9
    assert any("--torque none" in sentence for sentence in failures(without_torques, []))
    as_json(without_torques.to_json())


@pytest.mark.long
def test_late_readings_are_no_input_of_energy() -> None:
    """Every ninth reading is 4 ms late; the speeds from these readings let the energy rise by 64 % of its range."""
    rig, runs, laws = recordings(77016, rate_hz=200.0, logger="late", rough=True)
    names = ("encoder_eccentricity_joint2", "coulomb_joint2", "spring_joint1", "encoder_offset_joint2")
    late = diagnose(runs, rig, library={name: EFFECTS[name] for name in names})
    assert {finding.name for finding in late.sensor_findings} == {"periodic_delay"}
    assert "energy" not in late.sentence
    assert late.effects[0].name == laws[0].name == names[0]


@pytest.mark.long
def test_halved_angles_of_a_small_swing_are_a_hint_and_no_cause_is_named(tmp_path: Path) -> None:
    """A swing of 20 degrees hardly depends on its amplitude: friction and cogging explain most of the difference."""
    rig, file = load_rig(SAMPLES / "bench.toml"), tmp_path / "low.csv"
    rows = np.loadtxt(SAMPLES / "low.csv", delimiter=",", skiprows=1) * [1.0, 0.5, 0.5]
    np.savetxt(file, rows, "%.10g", ",", header="time_s,angle1_deg,angle2_deg", comments="")
    run = import_csv(file, rig, ImportOptions(unit="deg", zero="hanging", angles="relative"))
    halved = diagnose([run], rig, library={name: EFFECTS[name] for name in ("coulomb_joint2", "detent_joint2")})
    assert (halved.verdict, halved.effects) == ("unexplained", [])
    assert "both joints turn by 2 times the reading" in halved.sentence
    assert "--scale 2" in halved.sentence


@pytest.mark.long
def test_a_single_rod_at_half_its_scale_is_asked_for_the_scale_and_given_no_spring(
    tmp_path: Path, few_readings: Callable[[str], None]
) -> None:
    """Gravity at half the angle is gravity and cogging of order two; friction does not change that."""
    few_readings("turns? by")
    rig, runs = one_rod.recorded(one_rod.Rod(offset=0.0, noise=1e-3, duration=5.0), 1, tmp_path)
    some = {name: EFFECTS[name] for name in ("coulomb_joint1", "spring_joint1", "detent_joint1")}
    right = diagnose(runs, rig, library=some)
    assert [effect.name for effect in right.effects] == ["coulomb_joint1"]
    halved = [replace(run, theta=np.pi + (run.theta - np.pi) / 2) for run in runs]
    asked = diagnose(halved, rig, library=some)
    assert (asked.verdict, asked.effects) == ("unexplained", [])
    assert "--scale 2" in asked.sentence


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3, 4, 5))])
def test_a_single_rod_that_is_read_correctly_is_not_asked_for_its_scale(seed: int, tmp_path: Path) -> None:
    rig, runs = one_rod.recorded(one_rod.drawn(seed), seed, tmp_path)
    result = diagnose(runs, rig, library=candidates("coulomb", "spring", "encoder_offset", "detent"))
    assert result.verdict != "unexplained"
    assert "--scale" not in result.sentence


@pytest.mark.long
def test_no_scale_is_asked_for_that_does_not_close_the_gap_either(tmp_path: Path):
    """A spring outside the library, and an encoder that slips on the way out."""
    t, w2 = np.arange(0.0, 4.0, 0.005), 60.0
    rig = bench_rigs.one_rod(1.5 * 9.81 / w2, 0.1, 4096, np.random.default_rng(0))

    def slope(_: float, x: NDArray[np.float64]) -> list[float]:
        return [x[1], -w2 * np.sin(x[0]) - 0.5 * x[1] - 8.0 * x[0] ** 3]

    angle = solve_ivp(slope, (0.0, t[-1]), [0.9, 0.0], "LSODA", t_eval=t, rtol=1e-8, atol=1e-9).y[0]
    outwards = angle * np.gradient(angle, t) > 0
    far = np.clip((np.abs(angle) - 0.1) / 0.05, 0.0, 1.0)
    reading = angle - 0.03 * outwards * far * np.sign(angle) * np.sin(30.0 * np.abs(angle)) ** 2
    run = bench_rigs.table(tmp_path, "slips", rig, {"t_s": t, "theta1_rad": reading})
    result = diagnose([run], rig, library={name: EFFECTS[name] for name in ("coulomb_joint1", "detent_joint1")})
    assert result.verdict == "unexplained"
    assert "--scale" not in result.sentence


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_rods_with_a_clamped_elbow_at_half_their_scale_are_asked_for_the_scale(
    paper: Rig, scale: float, few_readings: Callable[[str], None]
) -> None:
    few_readings("turns? by")
    pose = next(iter(paper.poses.values())).model_copy(update={"theta1": np.pi - 1.0, "theta2": np.pi - 0.2})
    rig = paper.model_copy(update={"poses": {"X1": pose}}).with_rods(elbow="clamped")
    (run,) = record(load_plant("paper", 1), rig, 4.0, 200)
    theta1 = np.pi + (run.theta[:, 1] - np.pi) * scale
    run = replace(run, theta=np.column_stack([run.theta[:, 0], theta1, theta1 + run.elbow]), counts=None)
    some = {name: EFFECTS[name] for name in ("coulomb_joint1", "spring_joint1", "detent_joint1")}
    result = diagnose([run], rig, library=some)
    assert result.effects == []
    assert ("--scale theta1=2" in result.sentence) == (scale == 0.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("logged_late_s", "verdict"), [pytest.param(0.0, "no_gap", marks=pytest.mark.long), (-0.04, "unexplained")]
)
def test_a_delay_that_is_shorter_than_coarse_rows_of_torques_is_no_cause(
    paper: Rig, tmp_path: Path, logged_late_s: float, verdict: str, few_readings: Callable[[str], None]
) -> None:
    few_readings("torque")
    table = next(table for table in mutated_tables(rig=paper) if table.name == "driven/every_tenth")
    run = import_csv(table.write(tmp_path), paper, replace(table.options, input_delay_s=logged_late_s))
    result = diagnose([run], paper, library={"input_delay": EFFECTS["input_delay"]})
    assert (result.verdict, result.effects) == (verdict, [])
    assert ("at the rate of the controller" in result.sentence) == (verdict == "unexplained")


@pytest.mark.slow
def test_torques_that_contradict_the_rig_file_s_inertia_are_unexplained_with_a_hint_at_the_sign(
    driven: list[Run], paper: Rig, few_readings: Callable[[str], None]
) -> None:
    few_readings("torque")
    runs = with_signs(driven, (1, -1))
    diagnosis = diagnose(runs, paper, library={name: SOME[name] for name in ("coulomb_joint1", "spring_joint2")})
    assert (diagnosis.verdict, diagnosis.effects) == ("unexplained", [])
    assert "sign of torque 2" in diagnosis.hints[0]


@pytest.mark.long
def test_a_gain_that_no_drive_has_gives_way_to_a_wrong_sign(driven: list[Run], paper: Rig) -> None:
    runs = with_signs(driven, (-1, 1))
    diagnosis = diagnose(runs, paper, library={"torque_scale_joint1": EFFECTS["torque_scale_joint1"]})
    assert diagnosis.verdict == "unexplained"
    assert "sign of torque 1" in diagnosis.hints[0]
    assert diagnosis.effects == []


@pytest.mark.slow
def test_recordings_that_cannot_show_a_gap_are_inconclusive(swings, paper: Rig, rng: np.random.Generator) -> None:
    noisy = [replace(run, theta=run.theta + rng.normal(0, 0.03, run.theta.shape), counts=None) for run in swings]
    diagnosis = diagnose(noisy, paper, library=SOME)
    assert diagnosis.verdict == "inconclusive"
    assert "cannot show a gap" in diagnosis.sentence
    assert failures(diagnosis, []) == ["inconclusive: the recordings cannot show a gap"]


def test_runs_without_motion_are_refused(swings, paper: Rig) -> None:
    still = [replace(run, theta=np.broadcast_to(run.theta[:1], run.theta.shape), counts=None) for run in swings]
    with pytest.raises(RunError, match="no motion to analyse"):
        diagnose(still, paper)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.94, pytest.param(1.06, marks=pytest.mark.long)])
def test_a_length_error_that_no_clock_can_have_is_led_by_the_length(swings, paper: Rig, factor: float) -> None:
    wrong = paper.model_copy(update={"rig": paper.rig.model_copy(update={"L1": factor * paper.L1})})
    (effect,) = diagnose(swings, wrong, library=TWINS).effects
    assert effect.name == "wrong_length_L1"
    assert effect.members == ["wrong_length_L1", "clock_rate"]
    assert effect.odds["clock_rate"] < 1e-3


def test_an_error_of_the_length_is_also_named_as_one_of_gravity() -> None:
    assert in_words("by wrong_length_L1.") == "by error of length L1 or gravity [wrong_length_L1]."


def test_a_size_is_the_less_plausible_the_further_beyond_its_scale() -> None:
    sizes = [effect_params({"clock_rate": {"excess": x}}) for x in (0.0, 1e-5, 1e-4, 1e-3, -1e-2)]
    prior = [plausibility(params, "clock_rate") for params in sizes]
    assert prior == pytest.approx([1.0, 1.0, 0.5, 1e-4, 1e-8], rel=1e-3)
    assert plausibility(effect_params({"wrong_length_L1": {"added_m": 2e-3}}), "wrong_length_L1") > 9.8


def test_a_cause_that_is_next_to_impossible_is_not_listed() -> None:
    causes = [EffectPosterior(name, (name,), (), p) for name, p in (("a", 0.9), ("b", 0.004), ("c", 0.3))]
    assert [entry.name for entry in listed_causes(causes)] == ["a", "c"]


@pytest.mark.slow
def test_a_gravity_that_no_place_on_earth_has_is_questioned_instead_of_the_length(
    paper: Rig, swings: list[Run]
) -> None:
    wrong = paper.model_copy(update={"rig": paper.rig.model_copy(update={"g": 9.0})})
    diagnosis = diagnose(swings, wrong, library=TWINS)
    assert (diagnosis.verdict, diagnosis.effects) == ("unexplained", [])
    assert "g = 9 m/s^2 in the rig file does not occur on earth" in diagnosis.sentence
    assert "With g = 9.81" in diagnosis.sentence


@pytest.mark.parametrize(
    ("ratio", "words"), [(1.03, "the size of the noise"), (3.21, "3.2 times the noise"), (112, "110 times the noise")]
)
def test_a_gap_of_the_size_of_the_noise_is_not_called_one_times_it(ratio: float, words: str) -> None:
    assert _in_noise(ratio) == words


@pytest.mark.slow
@pytest.mark.parametrize("sign", [pytest.param(-1, marks=pytest.mark.long), 1])
def test_a_small_swing_on_a_cart_shows_the_sign_of_the_cart_and_no_spring(tmp_path: Path, sign: int) -> None:
    """A cart of five times the mass of the rod, as a long arm: with the wrong sign it acts like a spring."""
    t, length, ratio = np.arange(0.0, 4.0, 0.01), 0.4, 1 / 6
    one = Measure(0.1)
    measured = RigMeasures("cart", length, None, one, None, mounted="inner", L0=10.0, arm="prescribed")
    rig = parse_rig(draft_rig(measured))

    def slope(_: float, x: NDArray[np.float64]) -> list[float]:
        """Angle and speed of a uniform rod, position and speed of the cart."""
        s, c, h = np.sin(x[0]), np.cos(x[0]), length / 2
        pushed = ratio * h * x[1] ** 2 * s - 2.0 * x[3]
        turned = -(9.81 * s + c * pushed) / (4 / 3 * h - ratio * h * c**2)
        return [x[1], turned, x[3], pushed - ratio * h * c * turned]

    angle, _, place, _ = solve_ivp(slope, (0.0, t[-1]), [0.12, 0.0, 0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-10).y
    noise = np.random.default_rng(15).normal(0.0, 5e-4, len(t))
    run = bench_rigs.table(
        tmp_path, "cart", rig, {"t_s": t, "theta0_rad": sign * place / 10, "theta1_rad": angle + noise}
    )
    some = {name: EFFECTS[name] for name in ("spring_joint1", "com_offset_link1", "coulomb_joint1")}
    diagnosis = diagnose([run], rig, library=some)
    assert diagnosis.effects == []
    assert ("--scale theta0=-1" in diagnosis.sentence) == (sign == 1)
    assert diagnosis.verdict == ("unexplained" if sign == 1 else "no_gap")


@pytest.mark.parametrize(
    ("changed", "start", "zero", "forced"),
    [
        ({"dry": 2.0}, 1.2, 0.0, False),
        ({"viscous": 1.0}, 0.1, 0.15, False),
        ({"yields": 0.1, "stiff": 30.0}, 1.2, 0.0, False),
        ({"torque": lambda t: 15.0 * np.sin(7.3 * t)}, 1.2, 0.0, True),
    ],
    ids=["Coulomb friction", "zero error larger than the swing", "compliant pivot", "motor"],
)
def test_a_motor_that_is_not_described_changes_the_energy_of_the_rod(
    tmp_path: Path, changed: dict[str, Any], start: float, zero: float, forced: bool
) -> None:
    rig = bench_rigs.one_rod(0.69, 0.115, 4000, np.random.default_rng(1))
    rod, t = replace(bench_rigs.Rod(21.4, 0.04, 0.0, 9e-3), **changed), np.arange(0.0, 4.0, 0.02)
    angle = zero + bench_rigs.rod_swing(rod, start, t)
    run = bench_rigs.table(tmp_path, "swing", rig, {"t_s": t, "theta1_rad": angle})
    result = unexplained_energy([run], rig)
    assert result.forced == forced
    assert ("Friction and known torques do not explain" in result.hint) == forced


def test_the_motion_of_a_prescribed_arm_supplies_energy(tmp_path: Path) -> None:
    rig = bench_rigs.one_rod(0.69, 0.115, 4000, np.random.default_rng(1))
    rod = replace(bench_rigs.Rod(21.4, 0.04, 0.0, 9e-3), torque=lambda t: 15.0 * np.sin(7.3 * t))
    t = np.arange(0.0, 4.0, 0.02)
    run = bench_rigs.table(tmp_path, "swing", rig, {"t_s": t, "theta1_rad": bench_rigs.rod_swing(rod, 1.2, t)})
    arm = ArmMotion(run.t, np.sin(run.t), np.cos(run.t))
    assert unexplained_energy([run], rig).forced
    assert not unexplained_energy([replace(run, arm=arm)], rig).forced


def test_the_angles_of_a_film_have_no_other_scale(monkeypatch, paper: Rig):
    monkeypatch.setattr(description_module, "other_scale", lambda *_: "An angle scale of 0.5")
    monkeypatch.setattr(description_module, "rising_energy", lambda *_: Description())
    chosen = SimpleNamespace(effects=(), at_noise_floor=True)
    bare = SimpleNamespace(residuals=SimpleNamespace(chi2=1.0, dof=1))
    made = SimpleNamespace(chosen=chosen, bare=bare)
    transferred = SimpleNamespace(withdrawn=(), oversized=())

    def hint(film_noise: float | None) -> str:
        sources = dict.fromkeys(("torques", "inner", "arm"))
        record = SimpleNamespace(run=SimpleNamespace(film_noise=film_noise, arm_mode="clamped", **sources))
        return description_module.description([record], paper, None, made, transferred).hint

    assert hint(None) == "An angle scale of 0.5"
    assert hint(0.002) == ""


@pytest.mark.parametrize("needed", [True, False])
def test_another_scale_must_replace_an_effect_that_is_needed(monkeypatch, needed: bool):
    """A zero error that a spring can imitate is no evidence of a scale."""
    chosen = SimpleNamespace(cost=100.0, chance=30.0, effects=("spring_joint1",), key=frozenset({"spring_joint1"}))
    smaller = SimpleNamespace(cost=131.0 if needed else 129.0, key=frozenset())
    residuals = SimpleNamespace(excess=1.0)
    bare = SimpleNamespace(estimate=SimpleNamespace(ratios=None), residuals=residuals)
    selection = SimpleNamespace(chosen=chosen, bare=bare, without={"spring_joint1": smaller})
    setup = SimpleNamespace(held=True, arm=None, arm_moves=False)
    scaled = SimpleNamespace(cost=101.0, residuals=residuals, at_noise_floor=True)
    monkeypatch.setattr(description_module, "_scaled_fit", lambda *_: scaled)
    problem = SimpleNamespace(segments=SimpleNamespace(setups=(setup,)))
    rig = SimpleNamespace(
        rods=SimpleNamespace(mounted="inner"), encoders=SimpleNamespace(counts_per_rev=(4096, 4096, 4096))
    )
    assert bool(description_module.other_scale(problem, selection, rig)) is needed


@pytest.mark.parametrize(("damping", "rises"), [(-0.0015, True), (0.0, False)])
def test_a_free_swing_whose_energy_rises_is_driven(tmp_path: Path, bare, damping: float, rises: bool) -> None:
    rod = one_rod.Rod(dry=0.0, damping=damping, offset=0.0, duration=8.0)
    rig, runs = one_rod.recorded(rod, 1, tmp_path, [np.radians(20.0)])
    problem, model = bare(runs, rig)
    described = rising_energy(problem, model)
    assert described.withholds == rises
    assert ("energy of the swing rises by" in described.hint) == rises
