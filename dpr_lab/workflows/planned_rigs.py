"""Rig files for the releases of a plan: poses, rods, added mass and arm mode."""

import re
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.errors import ConfigError
from dpr_lab.whole_file import write_text

if TYPE_CHECKING:
    from dpr_lab.planning.result import Plan, PlannedRelease
    from dpr_lab.rig import Rig
    from dpr_lab.rig_tables import AddedMass

ARM_MODES = {"held": "clamped", "free": "free", "driven": "driven"}
"""Mode of the arm in the rig file for each state of the arm in a planned release."""


def planned_poses(made: "Plan", rig: "Rig") -> "dict[str, PlannedRelease]":
    """Map names of new poses to the planned releases.

    The names are P1, P2, ...; names that the rig file already uses are skipped.
    """
    free = (name for number in count(1) if (name := f"P{number}") not in rig.poses)
    return dict(zip(free, made.releases, strict=False))


def planned_rigs(poses: "dict[str, PlannedRelease]", rig: "Rig", to: Path) -> dict[str, Path]:
    """Write a rig file for each setup of a plan.

    Args:
        poses: planned release for each name of a pose
        rig: the rig file of the plan
        to: file for the releases with the setup of `rig`; for another setup, the name of its first pose is appended

    Raises:
        ConfigError: a file cannot be written, or the rig file has a form in which its tables cannot be replaced.
    """
    assert rig.path is not None
    text = rig.path.read_text(encoding="utf-8").rstrip() + "\n"
    current_setup, files, described = _setup_of(rig), dict[str, Path](), {_setup_of(rig): to}
    for name, release in poses.items():
        files[name] = described.setdefault(_setup(release, rig), to.with_name(f"{to.stem}_{name}{to.suffix}"))
    for setup, file in described.items():
        base = text if setup == current_setup else _with_setup(text, setup, rig)
        poses_of_file = {name: poses[name] for name, written in files.items() if written == file}
        write_text(file, base + _pose_tables(poses_of_file), ConfigError)
    return files


RigSetup = tuple[str, str, str, str]
"""Setup of a rig: mounted rods, elbow, added mass as a TOML table, and mode of the arm."""


def _setup_of(rig: "Rig") -> RigSetup:
    return rig.rods.mounted, rig.rods.elbow, _mass_table(rig.added_mass), rig.arm.mode


def _setup(release: "PlannedRelease", rig: "Rig") -> RigSetup:
    held = release.arm == "held" and rig.arm.mode not in ("free", "driven")
    mode = rig.arm.mode if held else ARM_MODES[release.arm]
    return release.mounted, release.elbow, _mass_table(release.added_mass), mode


def _mass_table(mass: "AddedMass | None") -> str:
    if mass is None:
        return ""
    return f'[added_mass]\nrod = "{mass.rod}"\nmass = {mass.mass}\nposition = {mass.position}\n'


def _with_setup(text: str, setup: RigSetup, rig: "Rig") -> str:
    """Return the text of a rig file with a changed setup.

    Comments outside the replaced tables are kept.
    """
    from dpr_lab.rig import parse_rig

    mounted, elbow, mass, mode = setup
    for table in ("rods", "added_mass"):
        text = re.sub(rf"(?ms)^\[{table}\][^\n]*\n(?:(?!^\[).*?\n)*", "", text)
    text = re.sub(r'(?ms)(^\[arm\][^\n]*\n(?:(?!^\[).*?\n)*?mode\s*=\s*)"[^"]*"', rf'\1"{mode}"', text)
    text = f'{text.rstrip()}\n\n[rods]\nmounted = "{mounted}"\nelbow = "{elbow}"\n' + (f"\n{mass}" if mass else "")
    try:
        described = _setup_of(parse_rig(text))
    except ConfigError:
        described = None
    if described != setup:
        raise ConfigError(f"{rig.path}: write rods, added_mass and arm as tables [rods], [added_mass] and [arm]")
    return text


def _pose_tables(poses: "dict[str, PlannedRelease]") -> str:
    return "".join(
        f"\n[poses.{name}]\ntheta1 = {pose.theta1_rad:.4f}\ntheta2 = {pose.theta2_rad:.4f}\n"
        for name, pose in poses.items()
    )
