"""Define the options of a simulated device, as on the command line."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a simulated device."""

    rig: str | Path = "paper"
    plant: str | Path | None = None
    """Plant file, or name of a built-in plant; None: the default plant of the rig, see `chosen_plant`."""
    link: str = "pty"
    """Link to serve: `pty`, `slcan`, `tcp:PORT` or `virtual:CHANNEL`."""
    clock: str = "realtime"
    """Name of a clock in `sim_device.firmware.clock.CLOCKS`."""
    seed: int | None = None
    """Seed of noise and operator; None: the seed of the plant file."""
    draw: bool = False
    """Whether the true parameters are drawn around those of the plant file, from the seed."""
    draw_effects: str | None = None
    """Request for drawn parameters and effects, for `sim_device.trials.request.parse_request`, such as `single:clear`;
    None: no draw."""
    arm: str | None = None
    """Mode of the arm of a drawn plant, `free` or `driven`; None: the mode of the rig file."""
    baud: int | None = None
    """Bit rate of the link, bit/s; None for 921600 (serial) and 1000000 (CAN)."""
    uid: int = 0x51D0_0000_0001
    drift_ppm: float = 0.0
    """Error of the device's crystal, ppm."""
    torques: str | Path | None = None
    """Table that the drives replay from the release on: torques of the joints, or the input of a driven arm. None:
    there are no joint drives, and the drive of the arm runs the program of the plant file."""
    hand_error: float = 0.0
    """Error of the operator at every pose, rad."""
    fault: tuple[str, ...] = ()
    """Faults, as texts such as `drop=0.01`."""
    firmware: str = "python"
    """`python`, or `c` for the reference firmware."""


SEALED_PLANT = "sealed"
"""Value of the option `plant` that selects the sealed plant in the folder `device` next to the rig file."""
SEALED_FILE = Path("device") / "plant.toml"
SEALED_TORQUES = Path("device") / "torques.csv"
"""Table of torques that the drives of a sealed plant replay, if it has drives."""
