from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib import image
from matplotlib.colors import to_rgb

from dpr_lab.errors import DprError
from dpr_lab.report import style
from dpr_lab.report.figures import error_figure, evolution_figure, response_figure, run_figure, save_figures
from dpr_lab.report.run_names import local_time
from dpr_lab.run import Run
from tests.thinned import thinned


def line(axes, label):
    (matching,) = [line for line in axes.lines if line.get_label() == label]
    return matching


def drawn(axes, label):
    return np.array(line(axes, label).get_xdata()), np.array(line(axes, label).get_ydata())


@pytest.mark.parametrize("runs", [1, 6])
def test_the_response_shows_every_run_as_measured(runs, comparison):
    compared = [comparison(f"run {i}", held_out=i == 5) for i in range(runs)]

    figure = response_figure(compared)

    assert len(figure.axes) == 2 * runs
    for index, axes in enumerate(figure.axes):
        shown, axis = compared[index // 2], index % 2
        t, theta = drawn(axes, "measured")
        np.testing.assert_array_equal(t, shown.t)
        np.testing.assert_array_equal(theta, shown.measured[:, axis])
        assert axes.get_ylabel() == ("inner rod θ₁ (rad)", "outer rod θ₂ (rad)")[axis]
    assert [axes.get_xlabel() for axes in figure.axes[-2:]] == ["time since release (s)"] * 2
    assert all(f"run {i}" in figure.axes[2 * i].get_title(loc="left") for i in range(runs))


def test_titles_show_pose_and_time_instead_of_the_name_of_the_file(comparison):
    name = "20261121T101500Z_X1_1a2b3c4d"
    label = f"X1 ({local_time('20261121T101500Z')})"
    (axes, *_) = response_figure([comparison(name)]).axes
    assert axes.get_title(loc="left").startswith(f"{label}   |   ")
    t = np.arange(3) / 100
    run = Run(name, t, np.zeros((3, 3)), counts=None, pose="X1", rig_name="paper", rig_sha256="", rate_hz=100.0)
    assert run_figure(run).axes[0].get_title(loc="left") == label


def test_the_free_run_is_strong_to_the_horizon_and_faint_beyond(comparison):
    shown = comparison(horizon_s=1.2)

    inner, outer = response_figure([shown]).axes

    for axis, axes in enumerate((inner, outer)):
        near = shown.t <= 1.2
        (strong_t, strong), (faint_t, faint) = drawn(axes, "simulated, free run"), drawn(axes, "beyond the horizon")
        np.testing.assert_array_equal(strong, shown.free_run[near, axis])
        np.testing.assert_array_equal(faint[1:], shown.free_run[~near, axis])
        assert faint_t[0] == strong_t[-1]
        assert line(axes, "beyond the horizon").get_alpha() == style.BEYOND["alpha"]
        # a free run that still follows the measurement is not hidden below it
        assert line(axes, "beyond the horizon").get_zorder() > line(axes, "measured").get_zorder()
        assert drawn(axes, "predictability horizon")[0].tolist() == [1.2, 1.2]


def test_a_run_that_is_predictable_to_its_end_has_no_horizon_line(comparison):
    made = comparison()

    figure = response_figure([replace(made, horizon_s=float(made.t[-1]))])

    assert {line.get_label() for line in figure.axes[0].lines} == {"measured", "simulated, free run"}
    assert "predictable to the end" in figure.axes[0].get_title(loc="left")


def test_a_diverging_free_run_does_not_change_the_axis_of_the_measurement(comparison):
    made = comparison()
    away = np.where((made.t > 1.2)[:, None], made.free_run + 300, made.free_run)

    low, high = response_figure([replace(made, free_run=away)]).axes[1].get_ylim()

    assert low < made.measured[:, 1].min() < made.measured[:, 1].max() < high < 10


def test_the_error_figure_has_free_run_segments_and_noise_floor(comparison):
    shown = comparison()
    near = shown.t <= shown.horizon_s

    figure = error_figure([shown])

    assert len(figure.axes) == 4
    for axis in (0, 1):
        free, segments = figure.axes[2 * axis : 2 * axis + 2]
        error, residual = (drawn(axes, "measured − simulated")[1] for axes in (free, segments))
        np.testing.assert_array_equal(error, 1e3 * (shown.measured - shown.free_run)[near, axis])
        np.testing.assert_array_equal(residual, 1e3 * (shown.measured - shown.tracked)[:, axis])
        for axes in (free, segments):
            (band,) = axes.patches
            assert band.get_extents().transformed(axes.transData.inverted()).intervaly == pytest.approx(
                [-2e3 * shown.noise_rad[axis], 2e3 * shown.noise_rad[axis]]
            )
        assert "(mrad)" in free.get_ylabel()
        assert segments.get_ylabel() == "residual (mrad)"
    assert figure.axes[2].get_xlabel() == "free run up to the horizon: time since release (s)"


def test_the_evolution_has_a_logarithmic_cost_and_both_fitnesses(model):
    cost, fitness, population = evolution_figure(model()).axes

    assert cost.get_yscale() == "log"
    assert drawn(cost, "best_cost")[1].tolist() == [4e4, 300, 20, 1.5]
    assert drawn(fitness, "best_fitness")[1].tolist() == [0.01, 1, 6.4, 9.6]
    assert drawn(population, "population_fitness")[1].tolist() == [0.3, 0.7, 0.9, 0.99]
    assert drawn(population, "population_fitness")[0].tolist() == [0, 1, 2, 3]
    assert population.get_xlabel() == "generation"


@pytest.mark.slow
@pytest.mark.parametrize("best_cost", thinned([None, [], [0.0], [3.0, 0.0]], 2))
def test_a_search_without_a_usable_history_is_still_drawn(best_cost, model, tmp_path):
    whole, history = model(), {} if best_cost is None else {"best_cost": best_cost}

    searched = whole.model_copy(update={"search": whole.search.model_copy(update={"history": history})})
    assert len(save_figures(searched, [], tmp_path)) == 3


def test_lines_differ_by_more_than_their_colour():
    lines = (style.MEASURED, style.SIMULATED, style.BEYOND, style.HORIZON)

    assert len({(str(each["linestyle"]), each["linewidth"]) for each in lines}) == len(lines)


def test_measured_and_simulated_differ_in_grey():
    luminance = [np.dot(to_rgb(each["color"]), [0.2126, 0.7152, 0.0722]) for each in (style.MEASURED, style.SIMULATED)]

    assert abs(luminance[0] - luminance[1]) > 0.25


@pytest.mark.slow
def test_one_run_becomes_three_valid_pictures(model, comparison, tmp_path):
    paths = save_figures(model(), [comparison()], tmp_path / "new" / "folder")

    assert {name: path.name for name, path in paths.items()} == {
        "response": "response.png",
        "error": "error.png",
        "evolution": "evolution.png",
    }
    for path in paths.values():
        height, width, _ = image.imread(path).shape
        assert width >= 1200
        assert height > 300


@pytest.mark.long
def test_pictures_of_six_long_runs_stay_small(model, comparison, tmp_path):
    compared = [comparison(f"run {i}", samples=60_000, horizon_s=4.0) for i in range(6)]

    paths = save_figures(model(), compared, tmp_path)

    assert max(path.stat().st_size for path in paths.values()) < 400_000


@pytest.mark.slow
def test_a_run_may_have_any_name(model, comparison, tmp_path):
    names = ["costs $x_{$\n実行", "bytes \udcff\x07", "long " * 60, ""]

    save_figures(model(), [comparison(name, samples=200) for name in names], tmp_path)


def test_nothing_to_compare_gives_pictures_that_say_so():
    assert [text.get_text() for text in response_figure([]).texts] == ["No run was compared."]
    assert [text.get_text() for text in error_figure([]).texts] == ["No run was compared."]


@pytest.mark.slow
@pytest.mark.parametrize("samples", thinned([0, 1], 2))
def test_a_nearly_empty_run_and_a_simulation_of_nan_are_drawn(samples, model, comparison, tmp_path):
    made = comparison()
    cut = {name: getattr(made, name)[:samples] for name in ("t", "measured", "free_run", "tracked")}
    simulated_nan = replace(made, free_run=np.full_like(made.free_run, np.nan))

    save_figures(model(), [replace(made, **cut, free_run_rms_rad=np.full(2, np.nan)), simulated_nan], tmp_path)


@pytest.mark.long
def test_the_users_matplotlib_settings_neither_matter_nor_change(model, comparison, tmp_path):
    with matplotlib.rc_context({"text.usetex": True, "figure.dpi": 10, "lines.linewidth": 20}):
        before = dict(matplotlib.rcParams)
        paths = save_figures(model(), [comparison()], tmp_path)
        assert dict(matplotlib.rcParams) == before
    assert image.imread(paths["error"]).shape[1] >= 1200


@pytest.mark.slow
def test_a_folder_that_cannot_be_made_is_named(model, tmp_path):
    (tmp_path / "taken").write_text("a file")

    with pytest.raises(DprError, match=r"taken.*choose another folder"):
        save_figures(model(), [], tmp_path / "taken" / "report")
