"""Put a simulated device together from names, as the command line gives them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dpr_lab.rig import Rig, load_rig
from firmware_protocol.identity import DeviceInfo
from sim_device.board import Board
from sim_device.clock import CLOCKS, Clock
from sim_device.config import PlantConfig, drawn, load_plant
from sim_device.device import Device, identity
from sim_device.faults import Faults, parse_faults
from sim_device.foreign.plant import ForeignPlant
from sim_device.hand import PLACING_TIME
from sim_device.links import Framing, Link, SerialCodec, open_link
from sim_device.plant import Plant
from sim_device.rods import HANGING, Rods


@dataclass(frozen=True, slots=True)
class Options:
    """What can be chosen about a simulated device."""

    rig: str | Path = "paper"
    plant: str | Path = "paper"
    link: str = "pty"
    """`pty`, `slcan`, `tcp:PORT` or `virtual:CHANNEL`."""
    clock: str = "realtime"
    """A name of `CLOCKS`."""
    seed: int | None = None
    """Varies noise and hand; None takes the plant file's."""
    draw: bool = False
    """Draw the true parameters around the plant file's, from the seed."""
    draw_effects: str | None = None
    """Draw parameters and effects: a text of `sim_device.draw.parse_wanted`, such as `single:clear`."""
    baud: int | None = None
    """Bits per second of the line; None takes 921600 for serial and 1000000 for CAN."""
    uid: int = 0x51D0_0000_0001
    drift_ppm: float = 0.0
    """Error of the device's crystal."""
    hand_error: float = 0.0
    """How far the hand misses every pose, rad."""
    fault: tuple[str, ...] = ()
    """Texts such as `drop=0.01`."""
    firmware: str = "python"
    """`python`, or `c` for the reference firmware."""


def hidden_plant(options: Options) -> Plant | ForeignPlant:
    """The truth that a device with these options carries.

    Raises:
        ConfigError: a rig or plant file that is not found or not valid, or nothing that could be drawn.
    """
    rig = load_rig(options.rig)
    config = load_plant(options.plant, options.seed)
    if options.draw_effects is not None:
        from sim_device.draw import draw_plant, parse_wanted, settled

        wanted = parse_wanted(settled(options.draw_effects, config.seed))
        return plant_of(draw_plant(wanted, config, rig), rig)
    return plant_of(drawn(config, rig) if options.draw else config, rig)


def plant_of(config: PlantConfig, rig: Rig) -> Plant | ForeignPlant:
    """The plant that a plant file describes.

    Raises:
        ConfigError: effects that there are not, or not together.
    """
    return ForeignPlant(config, rig) if config.foreign else Plant(config, rig)


def assemble(options: Options) -> tuple[Board, Link, Faults]:
    """A device and its open link, ready for `serve`.

    Raises:
        ConfigError: a file or a fault that is not right.
        LinkError: no such link, or it cannot be opened.
    """
    rig, plant = load_rig(options.rig), hidden_plant(options)
    faults = parse_faults(options.fault, plant.config.seed)
    # Compiles the kernels, which may take seconds, before a host counts on an answer.
    plant.let_go(HANGING.theta, np.zeros(3), 1000.0, 0).theta(0, 2)
    plant.misread(HANGING.theta[None], np.zeros(1), 0)
    pace = CLOCKS[options.clock]
    board, framing = _firmware(options.firmware)
    link = open_link(options.link, options.baud, faults, bool(pace), framing)
    clock = Clock(pace, options.drift_ppm, link.line.fast_samples_hz)
    rods = Rods(
        plant,
        rig,
        placing_time=0.0 if clock.simulated else PLACING_TIME,
        hand_error=options.hand_error,
        clock_rate=clock.rate,
        faults=faults,
    )
    info = faults.identity(identity(rig, options.uid, link.line.rate_max_hz, clock.simulated))
    return board(info, rods, clock, faults), link, faults


def _firmware(name: str) -> tuple[Callable[[DeviceInfo, Rods, Clock, Faults], Board], Framing]:
    """The board that runs a firmware, and the firmware's own framing of a serial line."""
    if name == "python":
        return Device, SerialCodec
    from sim_device.c_device import CDevice
    from sim_device.c_firmware import CFraming, load

    load()  # compiles it where that was not done before
    return CDevice, CFraming
