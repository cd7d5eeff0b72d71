"""What a step works with: all that it knows of the app around it."""

from dataclasses import dataclass

from dpr_lab.errors import DprError
from dpr_lab.tui.keys import KeyNames
from dpr_lab.tui.recorder.connection import DeviceConnection
from dpr_lab.tui.terminal.sight import Sight
from dpr_lab.tui.workspace import Workspace


@dataclass(frozen=True, slots=True)
class Services:
    """The same for every step."""

    workspace: Workspace
    device: DeviceConnection
    order: tuple[str, ...]
    """Names of all steps in the order of the work."""
    keys: KeyNames
    sight: Sight
    """Whether the operator sees what is shown."""

    def key_of(self, step: str) -> str:
        """The key that shows the step of that name."""
        return self.keys.of(f"app.step_{self.order.index(step) + 1}")

    async def connect(self) -> None:
        """Call the device that the workspace names; raises as `require_free` does."""
        self.require_free()
        await self.device.open(self.workspace.link, self.workspace.rig, self.workspace.out / "runs")

    def require_free(self) -> None:
        """Raise DprError while an attempt is under way."""
        if self.device.attempt is not None:
            ways = f"press {self.key_of('Capture')}, then {self.keys.of('capture.end')}"
            raise DprError(f"A capture is under way: end it first ({ways})")
