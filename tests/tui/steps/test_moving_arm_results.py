"""Steps 4 and 5 with a rotary pendulum whose arm is driven: ratios of rod, arm and drive, and their residuals."""

from pathlib import Path

import numpy as np
import pytest
from textual.widgets import Select, Static

from dpr_lab.acquisition.capture import CaptureOptions
from dpr_lab.identification.moving_arm.model import MovingArmModel, load_model
from dpr_lab.tui.steps.arm_results import start_of_diagnosis
from dpr_lab.tui.steps.compare import CompareStep
from dpr_lab.tui.steps.identify import IdentifyStep
from dpr_lab.tui.steps.second_curve import SecondCurve
from dpr_lab.tui.widgets.chart import Chart
from dpr_lab.workflows.capture import capture
from tests.tui.steps.test_identify import text


@pytest.fixture(scope="session")
def driven_run(made_once) -> Path:
    """A recorded swing of the built-in rotary pendulum."""

    def swing(folder: Path) -> None:
        options = CaptureOptions(duration=3.0)
        url = "sim://?plant=furuta&clock=fast&seed=1"
        assert capture("furuta", folder, options, lambda: True, poses=("X1",), url=url).ok

    (run,) = made_once("driven_run", swing).glob("*.mcap")
    return run


@pytest.mark.long
async def test_a_driven_arm_is_identified_and_compared_on_the_screen(lab, until, driven_run: Path) -> None:
    async with lab(IdentifyStep, CompareStep, rig="furuta", runs=[driven_run]) as pilot:
        identify, compare = pilot.app.query_one(IdentifyStep), pilot.app.query_one(CompareStep)
        await pilot.press("s")
        await until(pilot, lambda: identify.job is None)
        model = load_model(pilot.app.workspace.out / "model.json")
        assert isinstance(model, MovingArmModel)
        assert all(name in text(pilot.app, "#ratios-text") for name in model.ratios)
        assert "Ratios to the inertia a of the inner rod" in text(pilot.app, "#ratios-text")
        assert "the scale of the rig file" in text(pilot.app, "#nine-text")
        assert "ke kt gear²/R" in text(pilot.app, "#seen-text")
        assert start_of_diagnosis(pilot.app.workspace.model) is None
        assert "noise" in text(pilot.app, "#state")
        assert "mrad" not in text(pilot.app, "#state")  # the unit of the screen is degrees

        await pilot.press("2")
        await until(pilot, lambda: compare.job is None and compare.outcome())
        axis, view = pilot.app.query_one("#axis", Select), pilot.app.query_one("#view", Select)
        assert (axis.value, view.value) == (1, "angle")
        assert not pilot.app.query_one(SecondCurve).display
        series = pilot.app.query_one("#angle", Chart)._content.series
        assert [each.label for each in series] == ["measured", "simulated"]
        assert np.abs(series[0].y - series[1].y).max() < 1.0  # degrees
        assert (pilot.app.workspace.out / "report" / "report.html").is_file()
        assert "θ0" in str(pilot.app.query_one("#figures", Static).content)
        await pilot.press("v")
        assert view.value == "segment residual"
        await pilot.press("j")
        assert axis.value == 0
        assert "arm θ0" in pilot.app.query_one("#error", Chart)._content.y_label

        (before,) = compare._compared
        compare._compared_subject, compare._compared = None, ()
        compare.enter()  # as after the next start of the screen
        await pilot.pause()
        assert compare.job is None
        (stored,) = compare._compared
        assert np.array_equal(stored.simulated, before.simulated, equal_nan=True)
        assert (stored.run, stored.rms_rad, stored.held_out) == (before.run, before.rms_rad, before.held_out)
