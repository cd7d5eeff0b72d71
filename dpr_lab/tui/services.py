"""Services that the app offers to its steps."""

from dataclasses import dataclass

from dpr_lab.errors import DprError
from dpr_lab.tui.keys import KeyNames
from dpr_lab.tui.recorder.connection import DeviceConnection
from dpr_lab.tui.terminal.sight import Sight
from dpr_lab.tui.workspace import Workspace


@dataclass(frozen=True, slots=True)
class Services:
    """State and services shared by all steps."""

    workspace: Workspace
    device: DeviceConnection
    order: tuple[str, ...]
    """Names of all steps in order."""
    keys: KeyNames
    sight: Sight
    """Record of whether the operator sees the screen."""

    def key_of(self, step: str) -> str:
        """Return the key that shows the step with this name."""
        return self.keys.key_for(f"app.step_{self.order.index(step) + 1}")

    async def connect(self) -> None:
        """Start the handshake with the device of the workspace; see `require_free` for the errors."""
        self.require_free()
        await self.device.open(self.workspace.link, self.workspace.rig, self.workspace.out / "runs")

    def require_free(self) -> None:
        """Refuse an operation during an attempt.

        Raises:
            DprError: an attempt is in progress.
        """
        if self.device.attempt is not None:
            ways = f"press {self.key_of('Capture')}, then {self.keys.key_for('capture.end')}"
            raise DprError(f"A capture is under way: end it first ({ways})")
