"""Identifiability compared with SciPy's DOP853, finite differences and matrix inversion."""

import itertools
import json

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import RATIOS, base_parameters, ratios, whole_parameters
from dpr_lab.fitting.estimate import unknown_ratios
from dpr_lab.identification.directions import described
from dpr_lab.identification.expected import RELEASES, Releases, expected_releases, mounted_releases, ratio_information
from dpr_lab.identification.identifiability import Identifiability, identifiability, summary
from dpr_lab.identification.identify import identifiability as identifiability_of
from dpr_lab.identification.instruments import INSTRUMENTS
from dpr_lab.identification.prior_update import posterior_of
from dpr_lab.identification.ratio_fit import information as fisher_information
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.rig_tables import AddedMass, Parameter
from tests.identification.test_prior_update import update_prior

TRUE = np.array([0.21, 0.19, 0.104, 0.093, 0.215, 0.00107, 0.00093, 0.00139, 0.00128])
STD = {"l": 5e-4, "m": 1e-4, "c": 1e-5, "J": 1e-5}
SCALE = {"m1", "m2", "mb", "c1", "c2", "J1", "J2"}


@pytest.fixture(scope="module")
def rig() -> Rig:
    """Rig without special parameter values, read at 200 Hz."""
    return Rig.model_validate(
        {
            "rig": {"name": "test", "L1": 0.4, "L2": 0.42},
            "parameters": {
                name: {"nominal": true, "lower": 0.8 * true, "upper": 1.2 * true}
                for name, true in zip(PARAMETERS, TRUE.tolist(), strict=True)
            },
            "poses": {"X1": {"theta1": np.pi, "theta2": 0.1}, "X2": {"theta1": 0.1, "theta2": 0.1}},
            "link": {"rate_hz": 200},
        }
    )


def expected_information(Z: ArrayLike, rig: Rig, releases: Releases = RELEASES) -> NDArray:
    """Compute the Fisher information of one release from each pose of a rig."""
    return fisher_information(*mounted_releases(Z, rig, releases))


@pytest.fixture(scope="module")
def information(rig: Rig) -> NDArray:
    return expected_information(TRUE, rig)


@pytest.fixture(scope="module")
def analysis(rig: Rig, information: NDArray) -> Identifiability:
    return identifiability(information, rig)


def measured(rig: Rig, *names: str) -> Rig:
    known = {
        name: Parameter(nominal=p.nominal, measured=p.nominal, std=STD[name[0]])
        for name, p in rig.parameters.items()
        if name in names
    }
    return rig.model_copy(update={"parameters": rig.parameters | known})


def swings(Z: NDArray, starts: NDArray, t: NDArray, rig: Rig) -> NDArray:
    """Angles (n, 2, lanes) by DOP853 from docs/theory.md equation (1) in the nine parameters."""
    l1, l2, m1, m2, mb, c1, c2, J1, J2 = Z
    L1, g = rig.rig.L1, rig.rig.g
    a, b, d = J1 + m1 * l1**2 + (m2 + mb) * L1**2, J2 + m2 * l2**2, m2 * L1 * l2
    e1, e2 = (m1 * l1 + (m2 + mb) * L1) * g, m2 * l2 * g

    def slope(_t: float, x: NDArray) -> NDArray:
        t1, t2, w1, w2 = x.reshape(4, -1)
        c, s = d * np.cos(t1 - t2), d * np.sin(t1 - t2)
        f1 = -s * w2**2 - c1 * w1 - c2 * (w1 - w2) + e1 * np.sin(t1)
        f2 = s * w1**2 - c2 * (w2 - w1) + e2 * np.sin(t2)
        return np.concatenate([w1, w2, (b * f1 - c * f2) / (a * b - c**2), (a * f2 - c * f1) / (a * b - c**2)])

    solved = solve_ivp(slope, (t[0], t[-1]), starts.ravel(), "DOP853", t, rtol=1e-12, atol=1e-12)
    return solved.y.T.reshape(len(t), 4, -1)[:, :2]


def test_rank_and_singular_values_are_those_of_finite_differences(rig: Rig) -> None:
    releases = Releases(duration_s=3.0)
    one = rig.model_copy(update={"poses": {"X1": rig.poses["X1"]}})
    count = 2 * np.pi / 16384
    covariance = (0.5**2 + 1 / 12) * count**2 * np.array([[1.0, 1.0], [1.0, 2.0]])
    W, h = np.linalg.inv(np.linalg.cholesky(covariance)), 1e-3
    parts = []
    problem, at = expected_releases(base_parameters(TRUE, 0.4, 9.81), one, list(one.poses.values()), releases)
    for t, start in zip(np.split(problem.t, problem.segments.offsets[1:-1]), at.initial, strict=True):
        steps = h * np.hstack([np.eye(13), -np.eye(13)])
        Z = TRUE[:, None] * (1 + steps[:9])
        theta = swings(Z, start[:, None] + steps[9:], t, one)
        slopes = np.einsum("ij,njk->nik", W, (theta[..., :13] - theta[..., 13:]) / (2 * h)).reshape(-1, 13)
        by_start = slopes[:, 9:]
        parts.append(slopes[:, :9] - by_start @ np.linalg.lstsq(by_start, slopes[:, :9], rcond=None)[0])
    brute = np.linalg.svd(np.vstack(parts), compute_uv=False)
    result = identifiability(expected_information(TRUE, one, releases), one)
    assert result.rank == 5
    assert result.singular_values == pytest.approx(brute[:5], rel=1e-3)
    assert brute[5] < 1e-3 * brute[4]


@pytest.mark.parametrize("index", range(4))
def test_along_a_free_direction_the_swing_changes_in_second_order_only(
    analysis: Identifiability, rig: Rig, index: int
) -> None:
    n = np.array([analysis.null_space[index].get(name, 0.0) for name in PARAMETERS])
    lanes = np.transpose([0 * n, n, 2 * n, 0.01 * (np.arange(9) == PARAMETERS.index("J2"))])
    start = np.repeat(np.array([[np.pi], [0.1], [0.0], [0.0]]), 4, axis=1)
    theta = swings(TRUE[:, None] * (1 + lanes), start, np.arange(0.0, 2.0, 0.01), rig)
    once, twice, alone = np.max(np.abs(theta[..., 1:] - theta[..., :1]), axis=(0, 1))
    assert twice < 1e-8 or twice == pytest.approx(4 * once, rel=0.1)
    assert alone > 50 * once


def test_the_common_scale_is_one_of_four_free_directions(analysis: Identifiability, information: NDArray) -> None:
    assert len(analysis.null_space) == 4
    assert analysis.null_space[0] == pytest.approx(dict.fromkeys(sorted(SCALE, key=PARAMETERS.index), 0.01))
    assert described(analysis.null_space[0]) == "m1, m2, mb, c1, c2, J1, J2 +1 %"
    assert max(len(direction) for direction in analysis.null_space[1:]) <= 5
    rows = np.array([[direction.get(name, 0.0) for name in PARAMETERS] for direction in analysis.null_space])
    assert np.linalg.matrix_rank(rows, tol=1e-4) == 4


def test_cramer_rao_std_is_the_root_of_the_inverse_information(analysis: Identifiability, information: NDArray) -> None:
    std = np.sqrt(np.diag(np.linalg.inv(information)))
    assert list(analysis.cramer_rao_std) == list(RATIOS)
    assert list(analysis.cramer_rao_std.values()) == pytest.approx(std, rel=1e-6)


@pytest.mark.parametrize(
    "names",
    [
        *itertools.combinations(("l2", "m1", "m2", "mb"), 3),
        ("l2", "m1", "m2", "mb"),
        ("l1", "l2", "m1", "m2", "c1"),
        ("c1",),
        PARAMETERS,
    ],
    ids=",".join,
)
def test_the_source_of_each_parameter_agrees_with_an_identification(
    rig: Rig, information: NDArray, names: tuple[str, ...]
) -> None:
    known = measured(rig, *names)
    result = identifiability(information, known)
    nine, _ = update_prior(ratios(base_parameters(TRUE, 0.4, 9.81)), np.linalg.inv(information), known)
    assert result.fixed_by == {name: value.fixed_by for name, value in nine.items()}
    for name, value in nine.items():
        # a small part of each std comes from bounds, as a lognormal prior here and as a uniform prior there
        assert result.parameters[name].std == (None if value.std is None else pytest.approx(value.std, rel=1e-2))


def test_weighing_three_parts_leaves_one_direction_which_a_centroid_or_a_known_mass_closes(
    rig: Rig, information: NDArray
) -> None:
    weighed = identifiability(information, measured(rig, "m1", "m2", "mb"))
    assert [set(direction) for direction in weighed.null_space] == [{"l1", "l2", "c1", "c2", "J1", "J2"}]
    advice = {a.name: a for a in weighed.advice}
    assert not {"weigh m1", "weigh m2", "weigh mb"} & set(advice)
    for name in ("balance l1", "balance l2", "add mass to inner rod", "add mass to outer rod"):
        assert set(advice[name].frees) == {"l1", "l2", "c1", "c2", "J1", "J2"}
    assert advice["swing outer rod alone"].gain_bits == pytest.approx(0, abs=1e-6)
    assert "adds no information" in advice["swing outer rod alone"].sentence
    assert len(weighed.sequence) == 1


def test_four_measured_values_leave_no_free_direction_and_state_which_parameters_they_determine(
    rig: Rig, information: NDArray
) -> None:
    closed = identifiability(information, measured(rig, "m1", "m2", "mb", "l2"))
    assert closed.null_space == ()
    assert closed.sequence == ()
    assert {"c1", "c2", "J2"} <= set(closed.helps["l2"])
    assert set(closed.fixed_by.values()) == {"data", "measured"}


def test_following_the_sequence_fixes_all_nine(analysis: Identifiability) -> None:
    assert len(analysis.sequence) == 4
    assert {name for advice in analysis.sequence for name in advice.frees} == set(PARAMETERS)
    assert sum(len(advice.frees) for advice in analysis.sequence) == 9
    assert analysis.sequence[0] == analysis.advice[0]


def loaded_base(Z: NDArray, rod: str, mass: float, r: float, rig: Rig) -> NDArray:
    L1, g = rig.rig.L1, rig.rig.g
    per_mass = [r**2, 0, 0, r * g, 0, 0] if rod == "inner" else [L1**2, r**2, L1 * r, L1 * g, 0, 0]
    return base_parameters(Z, L1, g) + mass * np.array(per_mass)


def differences(function, at: NDArray) -> NDArray:
    h = 1e-5 * at
    columns = [(function(at + step) - function(at - step)) / (2 * step.sum()) for step in np.diag(h)]
    return np.transpose(columns)


def brute_force_gains(information: NDArray, rig: Rig) -> dict[str, float]:
    """Information of each measurement, bits, from explicit inverses and finite differences of its reading."""

    def unloaded(Z: NDArray) -> NDArray:
        return ratios(base_parameters(Z, rig.rig.L1, rig.rig.g))

    def std(matrix: NDArray, size: NDArray) -> NDArray:
        return np.sqrt(np.diag(np.linalg.inv(matrix * np.outer(size, size))))[:9]

    def itself(name: str):
        return lambda Z: Z[[PARAMETERS.index(name)]]

    def alone(rod: int):
        return lambda Z: np.array([Z[6 + rod] / (Z[1 + rod] * Z[rod - 1]) + Z[rod - 1]])

    J = differences(unloaded, TRUE)
    known = J.T @ information @ J + np.diag(12 / (0.4 * TRUE) ** 2)
    before = std(known, TRUE)
    read = {f"weigh {n}": (itself(n), 1e-4) for n in ("m1", "m2", "mb")}
    read |= {f"balance {n}": (itself(n), 5e-4) for n in ("l1", "l2")}
    read |= {f"swing {name} rod alone": (alone(rod), 5e-4) for rod, name in enumerate(("inner", "outer"), 1)}
    gains = {}
    for name, (function, error) in read.items():
        row = differences(function, TRUE)
        gains[name] = np.log2(before / std(known + row.T @ row / error**2, TRUE)).sum()
    for rod, r in (("inner", 0.2), ("outer", 0.42)):
        at = np.concatenate([TRUE, [TRUE[3] / 2, r]])
        slopes = differences(lambda x, rod=rod: ratios(loaded_base(x[:9], rod, x[9], x[10], rig)), at)
        seen = ratio_information(loaded_base(TRUE, rod, at[9], r, rig), rig, [rig.poses["X1"]])
        whole = np.zeros((11, 11))
        whole[:9, :9] = known
        whole[9, 9], whole[10, 10] = 1 / 1e-4**2, 1 / 5e-4**2
        gains[f"add mass to {rod} rod"] = np.log2(before / std(whole + slopes.T @ seen @ slopes, at)).sum()
    return gains


def test_advice_gains_are_those_of_brute_force_covariances(
    analysis: Identifiability, rig: Rig, information: NDArray
) -> None:
    brute = brute_force_gains(information, rig)
    assert {i.name for i in INSTRUMENTS} == set(brute)
    for advice in analysis.advice:
        assert advice.gain_bits == pytest.approx(brute[advice.name], rel=1e-3, abs=1e-3)
    ranked = [(len(advice.frees), brute[advice.name]) for advice in analysis.advice]
    assert ranked == sorted(ranked, reverse=True)


def test_runs_with_a_known_mass_see_a_sixth_direction(rig: Rig, information: NDArray) -> None:
    loaded = rig.model_copy(update={"added_mass": AddedMass(rod="outer", mass=0.05, position=0.4)})
    both = expected_information(TRUE, loaded)
    assert both.shape == (6, 6)
    assert np.linalg.matrix_rank(both / np.sqrt(np.outer(np.diag(both), np.diag(both))), tol=1e-8) == 5
    both[:5, :5] += information
    result = identifiability(both, rig)
    assert result.rank == 6
    assert list(result.cramer_rao_std) == [*RATIOS, "b"]
    assert len(result.null_space) == 3
    assert not any("c1" in direction or "c2" in direction for direction in result.null_space)
    assert result.fixed_by["c1"] == result.fixed_by["c2"] == "data"


def test_a_length_error_moves_the_ratios_and_shows_as_residual(analysis: Identifiability) -> None:
    assert analysis.length_error is not None
    assert analysis.length_error.residual_over_noise > 1.1
    assert 1e-4 < abs(analysis.length_error.ratio_shift["d/b"]) < 0.02


def test_recordings_without_information_are_reported_without_an_exception(rig: Rig) -> None:
    blind = identifiability(np.zeros((5, 5)), rig.model_copy(update={"poses": {}}))
    assert blind.rank == 0
    assert len(blind.null_space) == 9
    assert set(blind.fixed_by.values()) == {"bound"}
    assert blind.length_error is None
    text = json.dumps(blind.to_json(), allow_nan=False)
    assert json.loads(text)["unknowns"]["a/b"]["cramer_rao_std"] is None


def test_json_and_summary_hold_what_was_found(analysis: Identifiability) -> None:
    whole = json.loads(json.dumps(analysis.to_json(), allow_nan=False))
    assert whole["rank"] == 5
    assert list(whole["parameters"]) == list(PARAMETERS)
    assert whole["advice"][0]["frees"] == list(analysis.advice[0].frees)
    short = summary(analysis)
    assert short["null_space"] == whole["null_space"]
    assert short["advice"][0] == analysis.advice[0].sentence


def test_recordings_of_the_inner_rod_alone_concern_only_this_rod(rig: Rig) -> None:
    unknown = unknown_ratios(whole_parameters(TRUE, 0.4, 9.81))
    share = unknown[0] - unknown[6]

    def of_rod(Z: NDArray) -> NDArray:
        l1, m1, mb, c1, J1 = Z
        a = J1 + m1 * l1**2 + mb * 0.4**2
        return np.array([(m1 * l1 + mb * 0.4) * 9.81 / a, c1 / a])

    names, std = ("l1", "m1", "mb", "c1", "J1"), np.array([1e-3, 1e-2]) * of_rod(TRUE[[0, 2, 4, 5, 7]])
    Z = TRUE[[0, 2, 4, 5, 7]]
    rows = differences(of_rod, Z) * Z / std[:, None]
    result = identifiability(np.diag((std * share) ** -2.0), rig, posterior_of(unknown, rig, [2, 3], alone=True))
    assert (result.rank, result.length_error) == (2, None)
    assert result.singular_values == pytest.approx(np.linalg.svd(rows, compute_uv=False), rel=1e-6)
    assert result.unknowns == pytest.approx(dict(zip(("e1/a", "c1/a"), of_rod(Z), strict=True)))
    assert list(result.cramer_rao_std.values()) == pytest.approx(std, rel=1e-6)
    assert tuple(result.parameters) == names
    outer = {"l2", "m2", "c2", "J2"}
    assert not outer & {name for direction in result.null_space for name in direction}
    assert not outer & {name for advice in result.advice for name in advice.frees}
    assert {advice.name for advice in result.advice} == {
        "weigh m1", "weigh mb", "balance l1", "swing inner rod alone"
    }  # fmt: skip


def test_a_friction_that_is_fixed_at_zero_leaves_the_analysis_finite(rig: Rig, information: NDArray) -> None:
    unknown = unknown_ratios(whole_parameters(TRUE, 0.4, 9.81))
    unknown[RATIOS.index("c1/b")] = 0.0
    result = identifiability(information, rig, posterior_of(unknown, rig), lengths=False)
    assert np.isfinite(result.singular_values).all()
    assert all(np.isfinite(parameter.value) for parameter in result.parameters.values())


def test_expected_releases_of_the_inner_rod_alone_determine_its_two_ratios(rig: Rig) -> None:
    result = identifiability_of([], rig.with_rods(mounted="inner"))
    assert isinstance(result, Identifiability)
    assert (result.rank, list(result.unknowns)) == (2, ["e1/a", "c1/a"])
    assert set(result.parameters) == {"l1", "m1", "mb", "c1", "J1"}
    assert not any("outer" in advice.name for advice in result.advice)
    l1, _, m1, _, mb, c1, _, J1, _ = TRUE
    a, e1 = J1 + m1 * l1**2 + mb * 0.4**2, (m1 * l1 + mb * 0.4) * 9.81
    assert list(result.unknowns.values()) == pytest.approx([e1 / a, c1 / a], rel=1e-6)
    assert 0.0 < result.cramer_rao_std["e1/a"] < 0.01 * e1 / a


@pytest.mark.parametrize("rods", [{"mounted": "outer"}, {"elbow": "clamped"}])
def test_expected_releases_of_other_mountings_determine_fewer_ratios(rig: Rig, rods: dict[str, str]) -> None:
    result = identifiability_of([], rig.with_rods(**rods))
    assert isinstance(result, Identifiability)
    assert result.rank < 5
    assert np.isfinite(list(result.cramer_rao_std.values())).all()
