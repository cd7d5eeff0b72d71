"""Assemble a simulated device from the options of the command line."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from dpr_lab.rig import load_rig
from firmware_protocol.identity import DeviceInfo
from sim_device.faults import Faults, parse_faults
from sim_device.firmware.board import Board
from sim_device.firmware.clock import CLOCKS, Clock
from sim_device.firmware.python_board import PythonBoard, identity
from sim_device.links.byte_link import Framing, SerialCodec
from sim_device.links.link import DeviceLink
from sim_device.links.open_link import open_link
from sim_device.options import SEALED_FILE, SEALED_PLANT, SEALED_TORQUES, Options
from sim_device.plant.arm_drive import ArmDrive, arm_drive_of, replaying
from sim_device.plant.config import PlantConfig, chosen_plant
from sim_device.plant.drives import JointDrives, load_drives
from sim_device.plant.hidden import HiddenPlant, plant_of
from sim_device.plant.operator import HABITS
from sim_device.plant.rods import SimulatedRods
from sim_device.plant.warm_up import warm_up
from sim_device.trials.draw import draw_plant
from sim_device.trials.driven import drawn_drives
from sim_device.trials.parameters import drawn
from sim_device.trials.request import parse_request, with_kind


def hidden_plant(options: Options) -> HiddenPlant:
    """Create the plant of a device with these options.

    Raises:
        ConfigError: a rig or plant file is missing or invalid, or the requested draw is impossible.
    """
    rig = load_rig(options.rig)
    plant = Path(options.rig).parent / SEALED_FILE if options.plant == SEALED_PLANT else options.plant
    config = chosen_plant(plant, rig, options.seed)
    if options.draw_effects is not None:
        wanted = parse_request(with_kind(options.draw_effects, config.seed))
        return plant_of(draw_plant(wanted, config, rig), rig)
    return plant_of(drawn(config, rig) if options.draw else config, rig)


def assemble(options: Options, *, at_once: bool = False) -> tuple[Board, DeviceLink, Faults]:
    """Create board, open link and faults of a device, for `serve`.

    Args:
        options: options of the device
        at_once: whether a device in real time answers before its kernels are compiled. The operator then moves the rods
            only after the compilation.

    Raises:
        ConfigError: an invalid file or fault.
        LinkError: the link is unknown or cannot be opened.
    """
    rig, plant = load_rig(options.rig), hidden_plant(options)
    drives = _drives(options, plant.config)
    if isinstance(drives, JointDrives):
        plant.refuse_drives()
    frames = 1 if drives is None else 1 + len(drives.kinds)
    faults = parse_faults(options.fault, plant.config.seed)
    pace = CLOCKS[options.clock]
    board, framing = _firmware(options.firmware)
    link = open_link(options.link, options.baud, faults, bool(pace), framing)
    clock = Clock(pace, options.drift_ppm, link.address.fast_samples_hz / frames)
    rods = SimulatedRods(
        plant,
        rig,
        placing_time=0.0 if clock.simulated else HABITS.placing_time,
        hand_error=options.hand_error,
        clock_rate=clock.rate,
        faults=faults,
        drives=drives,
        ready=warm_up(plant, rig, in_background=at_once and not clock.simulated),
    )
    info = identity(rig, options.uid, link.address.rate_max_hz // frames, clock.simulated)
    return board(faults.identity(with_drives(info, drives)), rods, clock, faults), link, faults


def _drives(options: Options, plant: PlantConfig) -> JointDrives | ArmDrive | None:
    """Return the drives of a device, or None for free swings.

    Joint drives replay the given, sealed or drawn table of torques. The drive of the arm runs the given table, or the
    program of the plant file.
    """
    if (arm := arm_drive_of(plant)) is not None:
        return arm if options.torques is None else replaying(arm, options.torques)
    sealed = Path(options.rig).parent / SEALED_TORQUES
    table = options.torques or (sealed if options.plant == SEALED_PLANT and sealed.is_file() else None)
    if table is not None:
        return load_drives(table, plant.drives, plant.seed)
    asked = options.draw_effects and parse_request(with_kind(options.draw_effects, plant.seed)).kind
    return drawn_drives(plant) if asked == "driven" else None


def with_drives(info: DeviceInfo, drives: JointDrives | ArmDrive | None) -> DeviceInfo:
    """Return the identity of a board, extended by its drives."""
    if drives is None:
        return info
    if isinstance(drives, ArmDrive):
        unit = drives.config.unit_micro
        return replace(info, input_kinds=drives.kinds, input_unit=unit, input_quantity=drives.quantity)
    return replace(info, torque_kinds=drives.kinds, torque_unit_uNm=drives.config.unit_uNm)


def _firmware(name: str) -> tuple[Callable[[DeviceInfo, SimulatedRods, Clock, Faults], Board], Framing]:
    """Return a function that creates a board with the named firmware, and its framing for a serial line."""
    if name == "python":
        return PythonBoard, SerialCodec
    from sim_device.firmware.c_board import CBoard
    from sim_device.firmware.c_firmware import CFraming, load

    load()  # compiles the firmware if necessary
    return CBoard, CFraming
