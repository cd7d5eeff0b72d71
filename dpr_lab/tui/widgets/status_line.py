"""Status line of every step: device, simulation, latch, recording, folder."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from textual.content import Content
from textual.widgets import Static

from dpr_lab.tui.recorder.connection import DeviceConnection


class StatusLine(Static):
    """Status line, which shows only values that are currently known."""

    def show(self, device: DeviceConnection, urgent: str, work: Sequence[str], folder: Path, now: float) -> None:
        """Draw the line if it has changed, without the least important parts if needed.

        Args:
            device: the device
            urgent: recording in progress or countdown; empty for none
            work: running computations
            folder: folder of the results
            now: current time, `time.monotonic()`, s
        """
        parts = [_device(device, now), _latch(device, now)]
        if urgent:
            parts.append(Content.styled(f" {urgent} ", "bold $background on $error"))
        lines = [Content("  ").join([*parts, *further]) for further in _rests(work, folder)]
        line = next((line for line in lines if line.cell_length <= self.content_size.width), lines[-1])
        if line != self.content:
            self.update(line, layout=False)


def _rests(work: Sequence[str], folder: Path) -> Iterator[list[Content]]:
    """Yield texts of running work and folder, longest first."""
    shorter = (work, work, [text.partition(",")[0] for text in work], [text.partition(" ")[0] for text in work])
    for k, texts in enumerate(shorter):
        shown = [Content.styled(f"▸ {', '.join(texts)}", "bold $primary")] if texts else []
        yield shown + [Content.styled(_shorter(folder), "dim")] * (k == 0)


def _device(device: DeviceConnection, now: float) -> Content:
    if device.opening is not None:
        return Content.styled(f"connecting, {now - device.opening:.0f} s", "bold $warning")
    if device.connected is not None:
        name = device.connected.info.uid[-8:]
        if device.connected.simulated:
            return Content.styled(f" SIMULATED {name} ", "bold $background on $accent")
        return Content.styled(f" rig {name} ", "bold $background on $success")
    if device.lost is not None:
        return Content.styled(f" LOST {device.lost.info.uid[-8:]} ", "bold $background on $error")
    return Content("no device")


def _latch(device: DeviceConnection, now: float) -> Content:
    sighting = device.seen
    if device.connected is None and device.lost is None:
        return Content("")
    if device.ordered is not None:
        known = "the latch opens" if device.fresh(now) else f"latch UNKNOWN, {sighting.ago(now)}"
        return Content.styled(f" RELEASE sent: {known} ", "bold $background on $warning")
    if not device.fresh(now) or sighting.latched is None:
        return Content.styled(f"latch UNKNOWN, {sighting.ago(now)}", "bold $warning")
    return Content.styled("latch CLOSED" if sighting.latched else "latch OPEN", "bold")


def _shorter(folder: Path, most: int = 24) -> str:
    home = Path.home()
    text = f"~/{folder.relative_to(home)}" if folder.is_relative_to(home) else str(folder)
    return text if len(text) <= most else f"…/{folder.name}"
