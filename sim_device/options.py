"""What can be chosen about a simulated device, as the command line names it."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a simulated device."""

    rig: str | Path = "paper"
    plant: str | Path = "paper"
    link: str = "pty"
    """`pty`, `slcan`, `tcp:PORT` or `virtual:CHANNEL`."""
    clock: str = "realtime"
    """A name of `sim_device.firmware.clock.CLOCKS`."""
    seed: int | None = None
    """Varies noise and operator; None takes the plant file's."""
    draw: bool = False
    """Draw the true parameters around the plant file's, from the seed."""
    draw_effects: str | None = None
    """Draw parameters and effects: a text of `sim_device.trials.request.parse_request`, such as `single:clear`."""
    baud: int | None = None
    """Bits per second of the line; None takes 921600 for serial and 1000000 for CAN."""
    uid: int = 0x51D0_0000_0001
    drift_ppm: float = 0.0
    """Error of the device's crystal."""
    torques: str | Path | None = None
    """A table of torques that the joint drives replay from the release on; None for a rig without drives."""
    hand_error: float = 0.0
    """How far the operator misses every pose, rad."""
    fault: tuple[str, ...] = ()
    """Texts such as `drop=0.01`."""
    firmware: str = "python"
    """`python`, or `c` for the reference firmware."""


SEALED_PLANT = "sealed"
"""Instead of a plant: the one sealed in `device/` in the folder of the rig file."""
SEALED_FILE = Path("device") / "plant.toml"
SEALED_TORQUES = Path("device") / "torques.csv"
"""What its drives replay, where it has any."""
