"""Options of a simulated device, as on the command line."""

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
    """Seed of noise and operator; None for that of the plant file."""
    draw: bool = False
    """Draw the true parameters around the plant file's, from the seed."""
    draw_effects: str | None = None
    """Draw parameters and effects: a text for `sim_device.trials.request.parse_request`, such as `single:clear`."""
    arm: str | None = None
    """Mode of the arm of a drawn plant, `free` or `driven`; None for that of the rig file."""
    baud: int | None = None
    """Bits per second of the line; None for 921600 (serial) and 1000000 (CAN)."""
    uid: int = 0x51D0_0000_0001
    drift_ppm: float = 0.0
    """Error of the device's crystal."""
    torques: str | Path | None = None
    """A table that the drives replay from the release on: torques of the joints, or the input of a driven arm. None: no
    joint drives, and the program of the plant file for the arm.
    """
    hand_error: float = 0.0
    """Error of the operator at every pose, rad."""
    fault: tuple[str, ...] = ()
    """Faults, as texts such as `drop=0.01`."""
    firmware: str = "python"
    """`python`, or `c` for the reference firmware."""


SEALED_PLANT = "sealed"
"""Value of the option for a sealed plant instead of a plant file: the plant in `device/`, in the folder of the rig
file."""
SEALED_FILE = Path("device") / "plant.toml"
SEALED_TORQUES = Path("device") / "torques.csv"
"""Table of torques that its drives replay, if it has drives."""
