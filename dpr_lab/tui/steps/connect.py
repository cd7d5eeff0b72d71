"""Step Connect: find a device and connect to it."""

import time
from contextlib import suppress
from functools import partial

from textual import on, work
from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Input, OptionList, Static
from textual.widgets.option_list import Option

from dpr_lab.errors import ConfigError, DprError
from dpr_lab.rig import load_rig
from dpr_lab.transports import TRANSPORTS
from dpr_lab.transports.discover import Links, SerialPortFound, discover
from dpr_lab.transports.simulated import compiles_first
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.recorder.messages import Connected, Exercise, Exercised, Idle, RecorderFailed, RecorderReport
from dpr_lab.tui.recorder.settings import SETTINGS
from dpr_lab.tui.services import Services
from dpr_lab.tui.steps.step import Step
from dpr_lab.tui.texts import NOTICES
from dpr_lab.tui.widgets.dialogs import confirm
from dpr_lab.tui.widgets.readout import BAD, GOOD, angles_text, losses, old_text, ordered_text

SIMULATED = TRANSPORTS["sim"].example
CONNECTING = "connecting ({connect.disconnect}: cancel)"
COMPILING = "compiling the simulated rig, only the first time: about half a minute ({connect.disconnect}: cancel)"
OWN = "or the URL of another link ({connect.edit} to enter it); empty: the link of the rig file"
UNTESTED = "not tested: press {connect.exercise}"
CLOSES = " (closes the latch)"
LINKS = "\n".join(f"- {kind.name}: `{kind.example}`" for kind in TRANSPORTS.values() if kind.example != SIMULATED)


class ConnectStep(Step):
    """Step that lists the available links and connects to a device."""

    NAME = "Connect"
    HELP = f"""
Choose the link to the device: one from the list, or your own URL (`{{connect.edit}}`).

{LINKS}
- a simulated rig, to try everything without hardware: `{{connect.simulate}}`; a connected rig is disconnected only
  after a confirmation

`{{connect.exercise}}` makes the device stream for two seconds and shows the received and lost samples, and the error
of its clock relative to this computer. This test closes the latch and leaves it closed.
"""
    BINDINGS = bindings("connect")

    def __init__(self, services: Services) -> None:
        super().__init__(services)
        self._exercised: Exercised | str = ""

    def compose(self) -> ComposeResult:
        """Build the list of links, the URL field, and the answer of the device."""
        yield OptionList(id="links")
        yield Input(placeholder=self.worded(OWN), id="url")
        with VerticalScroll(id="answer", can_focus=False):
            yield Static(id="device")

    def on_mount(self) -> None:
        """Search for links, and update the age of readings regularly."""
        self.set_interval(SETTINGS.fresh_s / 3, self._age)
        self.query_one(Input).value = self.workspace.link
        self.action_look()

    def outcome(self) -> str:
        """Return the short name of the connected device, or an empty text without a device."""
        connected = self.device.connected
        if connected is None:
            return ""
        return "simulated" if connected.url.startswith("sim:") else connected.info.uid[-8:]

    def enter(self) -> None:
        """Show the available links and focus their list."""
        self.query_one(OptionList).focus()
        self._draw()

    def hear(self, report: RecorderReport) -> None:
        """Update the page from a report of the recorder."""
        match report:
            case Connected():
                self._exercised = ""
                self.changed()
            case Idle():
                pass
            case Exercised():
                self._exercised = report
            case RecorderFailed():
                self._exercised = ""
                if (
                    report.alive or self.device.lost is not None or not self.display
                ):  # other messages are shown on the page
                    mild = report.alive and self.device.ordered is None and not report.unwritten
                    severity = "warning" if mild else "error"
                    self.notify(report.message, severity=severity, timeout=NOTICES.error_s)
            case _:
                return
        if self.display:
            self._draw()

    @on(OptionList.OptionSelected)
    async def _choose(self, event: OptionList.OptionSelected) -> None:
        if event.option.id is not None:
            await self._connect(event.option.id)

    @on(Input.Submitted)
    async def _given(self) -> None:
        await self._connect(self.query_one(Input).value)

    async def action_connect(self) -> None:
        """Connect to the selected link.

        If the list is not in focus or has no selection, the URL in the field is used.
        """
        links = self.query_one(OptionList)
        highlighted = links.highlighted_option if links.has_focus else None
        await self._connect(
            highlighted.id if highlighted is not None and highlighted.id else self.query_one(Input).value
        )

    async def _connect(self, url: str) -> None:
        self.services.require_free()
        self.query_one(Input).value = url
        self.workspace.link = self.query_one(Input).value.strip()
        self._exercised = ""
        await self.services.connect()
        self.query_one(OptionList).focus()
        self.action_look()  # the list begins with the link used last
        self.changed()
        self._draw()

    async def action_simulate(self) -> None:
        """Connect to a simulated rig.

        If a real rig is connected, a confirmation is requested first.
        """
        connected = self.device.connected
        if connected is None or connected.simulated:
            await self._connect(SIMULATED)
        else:
            question = f"Disconnect from {connected.url} and connect the simulator?"
            confirm(self.app, question, "Simulate", "Stay", partial(self._connect, SIMULATED))

    async def action_disconnect(self) -> None:
        """Disconnect from the device."""
        self.services.require_free()
        await self.device.close()
        self.changed()
        self._draw()

    def action_edit(self) -> None:
        """Focus the field for a URL."""
        self.query_one(Input).focus()

    def action_exercise(self) -> None:
        """Test the link."""
        if self.device.opening is not None:
            raise DprError(self.worded("The connection is not complete: wait, or cancel it with {connect.disconnect}"))
        connected = self.device.connected
        if connected is None:
            raise DprError("Connect a device first: choose a link and press Enter")
        exercise = Exercise(connected.rate_hz)
        self._exercised = f"streaming for {exercise.seconds:g} s ..."
        self.device.tell(exercise)
        self._draw()

    def _age(self) -> None:
        if self.display and not self.device.fresh(time.monotonic()):
            self._draw()

    @work(thread=True, exclusive=True)
    def action_look(self) -> None:
        """Search for links again."""
        links = discover()
        self.app.call_from_thread(self._list, links)

    def _list(self, offered: Links) -> None:
        links = self.query_one(OptionList)
        links.clear_options()
        for url, description in self._offers(offered).items():
            links.add_option(Option(Content(f"{url:<34} {description}"), id=url))
        if not offered.serial:
            hint = self.worded("no serial port found: connect the device and press {connect.look}")
            links.add_option(Option(Content(hint), disabled=True))
        links.highlighted = 0

    def _offers(self, links: Links) -> dict[str, str]:
        """Return the available links by URL, with the last used one first."""
        offers = {}
        if self.workspace.link:
            offers[self.workspace.link] = "used last"
        with suppress(ConfigError):
            of_rig = load_rig(self.workspace.rig).link.url
            if not of_rig.startswith("sim:"):  # the default of a rig file without a link
                offers.setdefault(of_rig, "link of the rig file")
        offers |= {f"serial://{port.device}?baud=921600": _described(port) for port in links.serial}
        offers |= {f"can://socketcan/{name}?bitrate=1000000": "CAN interface" for name in links.can_interfaces}
        return offers | {SIMULATED: "simulated rig, no hardware needed"}

    def _draw(self) -> None:
        shown, lines = self.query_one("#device", Static), Content("\n").join(self._lines())
        if shown.content != lines:
            shown.update(lines)

    def _lines(self) -> list[Content]:
        device, now = self.device, time.monotonic()
        if device.opening is not None:
            compiles = compiles_first(self.workspace.link)
            return [Content(self.worded(COMPILING if compiles else CONNECTING))]
        if device.connected is not None:
            return [*_identity(device.connected), *self._rods(now, device.connected.rods), *self._clock()]
        lines = [Content.styled(f"{BAD} {device.message}", "$error") if device.message else Content("not connected")]
        if device.lost is not None:
            lines.append(old_text(device.seen, device.ordered, now, self.workspace.unit, device.lost.rods))
        return lines

    def _rods(self, now: float, number: int) -> list[Content]:
        sighting, unit = self.device.seen, self.workspace.unit
        if sighting.theta is None:
            return []
        if not self.device.fresh(now):
            return [old_text(sighting, self.device.ordered, now, unit, number)]
        if self.device.ordered is not None:
            return [ordered_text(self.device.ordered, now)]
        latch = "closed, the rods are held" if sighting.latched else "open, the rods are free"
        return [_row("latch", latch), _row("angles", f"{angles_text(sighting.theta, unit, number)}  ({unit.scale})")]

    def _clock(self) -> list[Content]:
        if isinstance(self._exercised, str):
            closes = "" if self.device.seen.latched else CLOSES
            return [_row("link test", self._exercised or self.worded(UNTESTED) + closes)]
        arrived = losses(self._exercised.lost, f"{self._exercised.samples} samples, ")
        return [_row("link test", arrived), _row("clock", _clock_fit(self._exercised))]


def _described(port: SerialPortFound) -> str:
    return port.problem or (port.description if port.description != "n/a" else "serial port")


def _identity(connected: Connected) -> list[Content]:
    info = connected.info
    rows = [
        Content.styled(f"{GOOD} connected to {connected.url}", "bold $success"),
        _row("device", f"{info.uid}, firmware {info.firmware}, protocol {info.major}.{info.minor}"),
        _row("encoders", f"{', '.join(map(str, info.counts_per_rev))} counts per turn"),
        *(_row("link load", load) for load in connected.loads),
    ]
    return [*rows, Content.styled(f"{BAD} {connected.problem}", "$error")] if connected.problem else rows


def _clock_fit(exercised: Exercised) -> str:
    clock = exercised.clock
    if clock is None:
        return "not compared, because the time of this device is simulated"
    return (
        f"offset known to ±{1e6 * clock.offset_std:.0f} µs, rate error {clock.rate_ppm:+.0f} ±"
        f" {clock.rate_ppm_std:.0f} ppm"
        f" ({clock.n} pings, shortest {1e6 * clock.rtt_min:.0f} µs)"
    )


def _row(name: str, value: str) -> Content:
    return Content(f"{name:<10} {value}")
