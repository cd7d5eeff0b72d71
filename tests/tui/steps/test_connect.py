import os
from collections.abc import Callable
from pathlib import Path

import pytest
from textual.pilot import Pilot
from textual.widgets import Input, OptionList, Static

from dpr_lab.tui.app import DprApp
from dpr_lab.tui.recorder.messages import Connected, Exercised
from dpr_lab.tui.widgets.dialogs import Question
from firmware_protocol.identity import DeviceInfo
from tests.tui.steps.releases import connected

SIMULATED_TIME = DeviceInfo("1.0.0", "000051d000000001", (16384, 16384, 16384), 4000, 1000, simulated_time=True)


def shown(app: DprApp, selector: str) -> str:
    return str(app.query_one(selector, Static).render())


async def connect(pilot: Pilot[None], url: str) -> None:
    pilot.app.query_one("#url", Input).value = url
    pilot.app.query_one("#connect").focus()
    await pilot.press("c")


@pytest.mark.slow
async def test_links_are_listed_and_the_one_under_the_cursor_is_connected(app: DprApp, until) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        await until(pilot, lambda: app.query_one("#links", OptionList).option_count)
        links = app.query_one("#links", OptionList)
        assert links.get_option("sim://?plant=paper&seed=1")
        await pilot.press("end", "c")  # what is under the cursor, not what the field was left with
        await connected(pilot, until)
        assert app.focused is links  # the arrows choose another
        await until(pilot, lambda: "angles" in shown(app, "#device"))
        result = " ".join(shown(app, "#device").split())  # its rows are wrapped
        assert app.steps[0].outcome() == "simulated"
    assert "000051d000000001, firmware 1.0.0, protocol 1.2" in result
    assert "1000 Hz needs 140,000 bit/s, 15 % of 921600 baud (at most 80 % may be used)" in result
    assert "open, the rods are free" in result
    assert app.workspace.link.startswith("sim://")


@pytest.mark.slow
async def test_link_test_counts_samples_and_fits_the_clock(app: DprApp, until, rig) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        await connect(pilot, rig())
        await connected(pilot, until)
        await pilot.press("l")
        await until(pilot, lambda: "clock " in shown(app, "#device"))
        result = shown(app, "#device")
    assert "samples, none lost" in result
    assert "ppm" in result
    assert "shortest" in result


@pytest.mark.slow
async def test_simulated_time_has_no_clock_fit(app: DprApp) -> None:
    async with app.run_test(size=(80, 24)):
        app.device.connected = Connected("socket://rig:5000", SIMULATED_TIME, 1000, (), "")
        app.steps[0].hear(Exercised(1000, {}, None))
        assert "the time of this device is simulated" in " ".join(shown(app, "#device").split())
        app.device.connected = None


@pytest.mark.slow
async def test_a_connection_in_progress_is_named_and_can_be_cancelled(app: DprApp, until, notices_text) -> None:
    ours, theirs = os.openpty()  # nobody answers
    async with app.run_test(size=(80, 24)) as pilot:
        await connect(pilot, f"serial://{os.ttyname(theirs)}?baud=921600")
        await until(pilot, lambda: app.device.opening or app.device.message)
        assert app.device.opening, app.device.message
        await pilot.press("l")
        assert "The connection is not complete: wait, or cancel it with z" in notices_text(app)
        await pilot.press("z")
        await until(pilot, lambda: not app.device.opening)
        assert shown(app, "#device") == "not connected"
    os.close(ours)
    os.close(theirs)


@pytest.mark.slow
async def test_a_wrong_link_is_reported_with_the_remedy(app: DprApp, until, notices_text) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        for url, remedy in (
            ("gopher://x", "unknown kind of link 'gopher'; use for example: serial:///dev/ttyUSB0"),
            ("serial:///dev/ttyNOTHERE", "/dev/ttyNOTHERE"),
            ("sim://?speed=3", "speed"),
        ):
            await connect(pilot, url)
            await until(pilot, lambda remedy=remedy: remedy in shown(app, "#device"))
            assert remedy not in notices_text(app)  # once is enough
            assert app.steps[0].outcome() == ""


@pytest.mark.long
async def test_a_wrong_baud_rate_is_reported(app: DprApp, until, rig) -> None:
    url = rig().replace("921600", "115200")
    async with app.run_test(size=(80, 24)) as pilot:
        await connect(pilot, url)
        await until(pilot, lambda: "115200 baud is probably wrong" in shown(app, "#device"))


@pytest.mark.slow
async def test_a_device_that_goes_away_while_idle_is_noticed(app: DprApp, until, notices_text, cable: Callable) -> None:
    port = cable()
    async with app.run_test(size=(80, 24)) as pilot:
        await connect(pilot, port.url)
        await connected(pilot, until)
        port.pull()
        await until(pilot, lambda: app.device.connected is None)
        await until(pilot, lambda: "ttyRIG" in notices_text(app))
        assert app.steps[2].missing().startswith("Capture needs a device")
        port.plug()
        await pilot.press("c")
        await until(pilot, lambda: app.device.connected)


@pytest.mark.long
async def test_another_rig_greets_the_device_again(app: DprApp, until, tmp_path: Path, rig) -> None:
    other = tmp_path / "other.toml"
    text = (Path(__file__).parents[3] / "configs/rigs/paper.toml").read_text()
    other.write_text(text.replace("[16384, 16384, 16384]", "[4096, 4096, 4096]"))
    async with app.run_test(size=(80, 24)) as pilot:
        await connect(pilot, rig(clock="fast"))
        await connected(pilot, until)
        await pilot.press("2")
        app.query_one("#rig_file", Input).value = str(other)
        await pilot.press("u")
        await until(pilot, lambda: app.device.connected and app.device.connected.problem)
        assert "choose the device that belongs to it" in app.device.connected.problem


@pytest.mark.slow
async def test_the_simulator_replaces_a_rig_only_after_confirmation(app: DprApp, until, rig) -> None:
    # One key dropped a real link, and at 80 columns nothing said that what followed was simulated.
    url = rig()
    async with app.run_test(size=(80, 24)) as pilot:
        await connect(pilot, url)
        await connected(pilot, until)
        assert "SIMULATED" not in shown(app, "#status")
        await pilot.press("m")
        await until(pilot, lambda: isinstance(app.screen, Question))
        assert url in str(app.screen.query_one(Static).render())
        await pilot.press("n")
        await until(pilot, lambda: not isinstance(app.screen, Question))
        assert app.device.connected.url == url
        await pilot.press("m")
        await until(pilot, lambda: isinstance(app.screen, Question))
        await pilot.press("y")
        await until(pilot, lambda: app.device.connected is not None and app.device.connected.simulated)
        for key in "123456":
            await pilot.press(key)
            await until(pilot, lambda: "SIMULATED" in app.export_screenshot())
