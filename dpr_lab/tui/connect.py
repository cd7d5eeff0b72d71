"""Step 1: find the device and greet it."""

from typing import ClassVar

from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Input, OptionList, Static
from textual.widgets.option_list import Option

from dpr_lab.errors import DprError
from dpr_lab.transports import EXAMPLES
from dpr_lab.transports.discover import Links, SerialPortFound, discover
from dpr_lab.tui.orders import Connected, Exercise, Exercised, Failed, Idle, Report
from dpr_lab.tui.readout import BAD, GOOD, degrees
from dpr_lab.tui.step import ERROR_S, Step

SIMULATED = "sim://?plant=paper&seed=1"
EXERCISE_S = 2.0


class ConnectStep(Step):
    """Links found, one to choose, and what the device answered."""

    NAME = "Connect"
    HELP = f"""
Choose where the device is: a link from the list, or a URL of your own (`i`).

- serial port: `{EXAMPLES["serial"]}`
- CAN: `{EXAMPLES["can"]}`
- TCP: `{EXAMPLES["socket"]}`
- a simulated rig, to try everything without hardware: `s`

`x` lets the device stream for two seconds: what arrives, what is lost, and how well its clock follows this computer's.
That closes the latch, and leaves it closed.
"""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("c", "connect", "Connect", id="connect.connect"),
        Binding("s", "simulate", "Simulate", id="connect.simulate"),
        Binding("x", "exercise", "Test", id="connect.exercise"),
        Binding("u", "look", "Rescan", id="connect.look"),
        Binding("d", "disconnect", "Disconnect", id="connect.disconnect", show=False),
        Binding("i", "edit", "URL", id="connect.edit", show=False),
    ]

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self._idle: Idle | None = None
        self._exercised: Exercised | str = ""

    def compose(self) -> ComposeResult:
        """The links, a field for a URL, the answer."""
        yield OptionList(id="links")
        yield Input(placeholder="URL of the device; empty for the rig file's", id="url")
        with VerticalScroll(id="answer", can_focus=False):
            yield Static(id="device")

    def on_mount(self) -> None:
        """Look for links."""
        self.query_one(Input).value = self.bench.link
        self.action_look()

    def outcome(self) -> str:
        """Which device."""
        connected = self.lab.line.connected
        if connected is None:
            return ""
        return "simulated" if connected.url.startswith("sim:") else connected.info.uid[-8:]

    def enter(self) -> None:
        """Show what is known, with the list ready for Enter."""
        self.query_one(OptionList).focus()
        self._draw()

    def hear(self, report: Report) -> None:
        """Follow the connection."""
        match report:
            case Connected():
                self._idle, self._exercised = None, ""
                self.post_message(self.Done())
            case Idle():
                self._idle = report
            case Exercised():
                self._exercised = report
            case Failed():
                self._exercised = ""
                severity = "warning" if report.alive else "error"
                self.notify(report.said, severity=severity, timeout=ERROR_S, markup=False)
            case _:
                return
        if self.display:
            self._draw()

    @on(OptionList.OptionSelected)
    async def _choose(self, event: OptionList.OptionSelected) -> None:
        if event.option.id is not None:
            self.query_one(Input).value = event.option.id
            await self.action_connect()

    @on(Input.Submitted)
    async def action_connect(self) -> None:
        """Connect to the URL in the field."""
        self.lab.line.require_free()
        self.bench.link = self.query_one(Input).value.strip()
        self._exercised = ""
        await self.lab.connect()
        self.focus()
        self._draw()

    async def action_simulate(self) -> None:
        """Connect to a simulated rig."""
        self.query_one(Input).value = SIMULATED
        await self.action_connect()

    async def action_disconnect(self) -> None:
        """Let the device go."""
        self.lab.line.require_free()
        await self.lab.disconnect()
        self._draw()

    def action_edit(self) -> None:
        """Go to the field."""
        self.query_one(Input).focus()

    def action_exercise(self) -> None:
        """See what the link is worth."""
        if self.lab.line.opening:
            raise DprError("A connection is under way: wait for the device to answer, or press d to give it up")
        connected = self.lab.line.connected
        if connected is None:
            raise DprError("Connect a device first: choose a link and press Enter")
        self._exercised = f"streaming for {EXERCISE_S:g} s ..."
        self.lab.line.tell(Exercise(connected.rate_hz, EXERCISE_S))
        self._draw()

    def action_look(self) -> None:
        """Look for links again."""
        self._look()

    @work(thread=True, exclusive=True)
    def _look(self) -> None:
        found = discover()
        self.app.call_from_thread(self._list, found)

    def _list(self, found: Links) -> None:
        links = self.query_one(OptionList)
        links.clear_options()
        for url, said in self._offers(found).items():
            links.add_option(Option(Content(f"{url:<34} {said}"), id=url))
        if not found.serial:
            hint = "no serial port found: plug the device in and press u, or try the simulated rig"
            links.add_option(Option(Content(hint), disabled=True))
        links.highlighted = 0

    def _offers(self, found: Links) -> dict[str, str]:
        """URL -> what it is; the last one used comes first."""
        offers = {}
        if self.bench.link:
            offers[self.bench.link] = "used last"
        offers |= {f"serial://{port.device}?baud=921600": _described(port) for port in found.serial}
        offers |= {f"can://socketcan/{name}?bitrate=1000000": "CAN interface" for name in found.can_interfaces}
        return offers | {SIMULATED: "simulated rig, no hardware needed"}

    def _draw(self) -> None:
        self.query_one("#device", Static).update(Content("\n").join(self._lines()))

    def _lines(self) -> list[Content]:
        line = self.lab.line
        if line.opening:
            return [Content("connecting ... (d: give up)")]
        if line.connected is None:
            return [Content.styled(f"{BAD} {line.said}", "$error") if line.said else Content("not connected")]
        return [*_identity(line.connected), *self._rods(), *self._clock(line.connected)]

    def _rods(self) -> list[Content]:
        if self._idle is None:
            return []
        latch = "closed, the rods are held" if self._idle.latched else "open, the rods are free"
        return [_row("latch", latch), _row("angles", f"{degrees(self._idle.theta)}  (0 upright, 180 hanging)")]

    def _clock(self, connected: Connected) -> list[Content]:
        if isinstance(self._exercised, str):
            return [_row("link test", self._exercised or "not done: press x (closes the latch)")]
        lost = ", ".join(f"{n} {cause.replace('_', ' ')}" for cause, n in self._exercised.lost.items() if n)
        arrived = f"{self._exercised.samples} samples, {lost or 'none lost'}"
        return [_row("link test", f"{BAD if lost else GOOD} {arrived}"), _row("clock", _clock_fit(self._exercised))]


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
        return "not compared: this device's time is simulated"
    return (
        f"known to ±{1e6 * clock.offset_std:.0f} µs, runs {clock.rate_ppm:+.1f} ± {clock.rate_ppm_std:.1f} ppm"
        f" ({clock.n} pings, shortest {1e6 * clock.rtt_min:.0f} µs)"
    )


def _row(name: str, said: str) -> Content:
    return Content(f"{name:<10} {said}")
