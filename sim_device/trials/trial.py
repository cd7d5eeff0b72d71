"""Prepare a blind trial: drawn rig file and plant, seal, and optional recordings."""

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from dpr_lab.errors import ConfigError
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from sim_device.options import Options
from sim_device.plant.arm_drive import ArmDrive, InputTable, arm_drive_of
from sim_device.plant.config import PlantConfig, chosen_plant
from sim_device.plant.drives import JointDrives
from sim_device.plant.hidden import plant_of
from sim_device.trials.draw import described, draw_plant
from sim_device.trials.driven import drawn_drives
from sim_device.trials.moving_arm import with_arm
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import SPREAD, weighed
from sim_device.trials.request import ANY, FREE_SWINGS, ON_ARM, parse_request, with_kind
from sim_device.trials.seal import keep, salted, seal
from sim_device.trials.toml import toml_text

SEED_BITS = 128
"""Number of bits of a random seed. They are too many to find the seed by trials from the published data."""


@dataclass(frozen=True, slots=True)
class DrawnTrial:
    """Drawn plant with its sealed truth and its public part."""

    plant: PlantConfig
    rig: Rig
    """Rig as described by the rig file of the trial. The masses are drawn from a separate seed, and are rounded as by
    scales."""
    kept: dict[str, Any]
    """Sealed content: `truth` and `salt`."""
    drives: JointDrives | ArmDrive | None = None
    """Drives of the joints or of the arm; None for free swings."""

    def report(self, direct: bool) -> dict[str, Any]:
        """Return the public report of a drawn trial.

        It contains `seal`; `rig`, the rig file as TOML text; for a driven arm `largest_input`, the largest input of its
        program; and `runs`, if `direct`.
        """
        public: dict[str, Any] = {"seal": seal(self.kept["truth"], self.kept["salt"]), "rig": _rig_file(self.rig)}
        if self.plant.arm_drive is not None:
            public["largest_input"] = self.plant.arm_drive.amplitude
        return public | ({"runs": _runs(self)} if direct else {})


def drawn_trial(options: Options, around: Rig) -> DrawnTrial:
    """Draw a plant.

    Args:
        options: plant, requested draw (any kind by default) and seed
        around: the nominal rig

    Raises:
        ConfigError: the request is impossible.
    """
    seed, public = (secrets.randbits(SEED_BITS) if options.seed is None else options.seed for _ in range(2))
    around, base = with_arm(around, chosen_plant(options.plant, around, public), options.arm)
    kinds = FREE_SWINGS if around.arm.mode == "clamped" else ON_ARM
    wanted = parse_request(with_kind(options.draw_effects or ANY, seed, kinds))
    base, rig = weighed(base, around, SPREAD.scales_step)
    plant, rig = draw_plant(wanted, base.model_copy(update={"seed": seed}), rig), described(wanted, rig)
    drawn = {"kind": wanted.kind, "level": wanted.level, "seed": seed}
    drives = drawn_drives(plant) if wanted.kind == "driven" else arm_drive_of(plant)
    return DrawnTrial(plant, rig, salted(plant_of(plant, rig), drawn), drives)


def sealed_trial(options: Options, folder: Path, direct: bool = False) -> dict[str, Any]:
    """Draw and seal a plant.

    Args:
        options: rig, plant, requested draw (any kind by default) and seed
        folder: folder of the device for the truth
        direct: whether the plant is recorded at once, without device and link

    Returns:
        Report, see `DrawnTrial.report`.

    Raises:
        ConfigError: the request is impossible, or the folder exists already.
    """
    trial = drawn_trial(options, load_rig(options.rig))
    keep(trial.plant, trial.kept, folder, trial.drives if isinstance(trial.drives, JointDrives) else None)
    return trial.report(direct)


def recorded_next(trial: DrawnTrial, wanted: Mapping[str, Any], before: int) -> dict[str, Any]:
    """Record one requested release, as an experimenter would.

    Args:
        trial: the plant
        wanted: `theta1`, `theta2`, `duration_s`; optionally `rods` and `added_mass` as in a rig file, and `input` with
            `t` and `values`, which the drive of the arm runs in place of its program
        before: number of earlier releases; the operator errors differ each time

    Raises:
        ConfigError: the rig cannot make this release.
    """
    now = trial.rig.model_dump(exclude_none=True)
    changed = {name: wanted[name] for name in ("rods", "added_mass") if wanted.get(name)}
    pose = {"theta1": wanted["theta1"], "theta2": wanted["theta2"]}
    try:
        rig = Rig.model_validate({**now, **changed, "poses": {f"release {before + 1}": pose}})
    except ValidationError as error:
        raise ConfigError(f"no such release: {error.errors()[0]['msg']}") from error
    drives = trial.drives
    if (table := wanted.get("input")) is not None:
        if not isinstance(drives, ArmDrive):
            raise ConfigError("no such release: the arm of this plant has no drive")
        drives = replace(drives, table=InputTable(np.array(table["t"]), np.array(table["values"])))
    (run,) = record(trial.plant, rig, float(wanted["duration_s"]), drives=drives, before=before)
    return _as_json(run)


def _rig_file(rig: Rig) -> str:
    return toml_text(rig.model_dump(mode="json", exclude_none=True)).lstrip()


def _runs(trial: DrawnTrial) -> list[dict[str, Any]]:
    return [_as_json(run) for run in record(trial.plant, trial.rig, drives=trial.drives)]


def _as_json(run: Run) -> dict[str, Any]:
    return {
        "pose": run.pose,
        "rate_hz": run.rate_hz,
        "lost": dict(run.lost),
        "t": run.t.tolist(),
        "counts": [] if run.counts is None else run.counts.tolist(),
        **_torques(run),
        **({"arm_mode": run.arm_mode} if run.arm_mode != "clamped" else {}),
        **({"arm_input": run.arm_input.tolist()} if run.arm_input is not None else {}),
    }


def _torques(run: Run) -> dict[str, Any]:
    if run.torques is None:
        return {}
    known = {"torques": run.torques, "commanded": run.commanded}
    return {"torque_kind": run.torque_kind} | {name: v.tolist() for name, v in known.items() if v is not None}
