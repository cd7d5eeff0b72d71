"""Plant: true motion of the rods, and true behaviour of the encoders."""

import math
from collections.abc import Callable, Iterator
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.arm import CLAMPED, ArmParameters
from dpr_lab.dynamics.base import RATIOS, base_parameters, loaded, ratios
from dpr_lab.dynamics.encoder_errors import apply_encoder_errors, arm_lateness, held_along, read_at
from dpr_lab.dynamics.moving_arm.geared_motor import AnyState
from dpr_lab.dynamics.rig_constants import constants_of_run, rig_constants
from dpr_lab.dynamics.simulate import as_row, as_state, at_release, integrate, motors_of, rig_model
from dpr_lab.dynamics.step import RigModel, model_with
from dpr_lab.effects import EFFECTS, effect_params, param_index
from dpr_lab.effects.detent import DETENT_JOINT1, DETENT_JOINT2
from dpr_lab.effects.mounted import effects_of_run
from dpr_lab.effects.spring import SPRING
from dpr_lab.errors import ConfigError
from dpr_lab.rig import JOINTS, PARAMETERS, Rig
from dpr_lab.setup import Setup, Torques
from sim_device.plant.config import PlantConfig
from sim_device.plant.mount import AT_REST, CompliantMount

MAX_STEP = 1e-4
"""Maximum step of the simulation, s. Within the predictability horizon of a chaotic swing, its error is far below a
count."""

BLOCK_TIME = 1.0
"""Duration of a block of a swing, s. A swing is computed block by block."""

LOOK = 5e-4
"""Interval at which an encoder with play or delay, or a compliant mount, is evaluated, s."""

Driven = Callable[..., Any]
"""Function that returns the torques of drives.

For joint drives: function of (first, count) that returns the torques (count, 2) of joints 1 and 2 from each of these
ticks to the next, N m. For a driven arm: `ArmDrive.block` at the sample rate of the device.
"""

UNSEEN = Torques(np.zeros(1), np.zeros((1, 2)), on_arm=np.zeros(1))
"""Placeholder for the torques of a driven arm. It only selects the effects of the drive."""

CONSTANT = [param_index(effect.name, "constant_Nm") for effect in SPRING]
"""Index of the constant torque of each joint in the parameters. This torque represents that of a drive between two
ticks."""

RIPPLE, RIPPLE_ORDER = (
    [[param_index(effect.name, name) for name in names] for effect in (DETENT_JOINT1, DETENT_JOINT2)]
    for names in (("cos1_Nm", "sin1_Nm"), ("order",))
)
"""Indices of the detent of each joint in the parameters. The detent represents the ripple at a constant torque."""

NO_ROD = 1e-12
"""Mass, kg, and inertia, kg m^2, of a missing outer rod. With zero, joint 2 would have no equation of motion.

The value is so small because it increases the inertia of the mounted rod: 1e-9 kg m^2 would change the ratios of a
small pendulum by 7e-6.
"""

Theta = NDArray[np.float64]


class Block(NamedTuple):
    """Block of a swing."""

    t: Theta
    """(n,) true times since the release, s. The last one is the first time of the next block."""
    states: Theta
    """(n, 6 + internal) states, as in `RigState`."""
    asked: Theta
    """(ticks,) inputs that the program of the arm's drive requested; zeros without a drive."""


def mounted_rods(Z: NDArray[np.float64], setup: Setup) -> NDArray[np.float64]:
    """Return the parameters (9,) of the rods that are mounted."""
    l1, l2, m1, m2, mb, c1, c2, J1, J2 = Z
    if setup.mounting == "inner":
        return np.array([l1, l2, m1, NO_ROD, mb, c1, c2, J1, NO_ROD])
    if setup.mounting == "outer":
        return np.array([l2, l2, m2, NO_ROD, 0.0, c1, c2, J2, NO_ROD])
    return Z


class Plant:
    """True dynamics and effects of the rig.

    Args:
        config: the plant file
        rig: the rig file, whose lengths, gravity and added mass are true, because they are measured

    Raises:
        ConfigError: the plant file names an unknown effect or parameter, or effects that the plant cannot have.
    """

    def __init__(self, config: PlantConfig, rig: Rig) -> None:
        self.config = config
        self._frame = (rig.L0, rig.L1, rig.g)
        driven = UNSEEN if config.arm_drive is not None else None
        moves = config.arm.mode != "clamped"
        self._setup = Setup(rig.rods.mounting, rig.added_mass, torques=driven, arm_moves=moves)
        Z = config.Z if rig.added_mass is None else loaded(config.Z, rig.added_mass)
        masses = dict(zip(PARAMETERS[2:5], config.Z[2:5].tolist(), strict=True))
        self._Z = mounted_rods(Z, self._setup)
        self._constants = constants_of_run(rig_constants(rig)._replace(**masses), self._setup)
        self.pace = 1.0
        """True seconds per second of the device's clock, which differ from 1 by the clock effect."""
        self.delay = 0.0
        """Time by which joint 2 is read after joint 1, s."""
        self.arm_delay = 0.0
        """Time by which the arm is read after joint 1, s."""
        self.has_play = False
        """Whether the encoder of a rod has play."""
        self.mount: CompliantMount | None = None
        """The mount if it is compliant; otherwise None."""
        if config.mount is not None:
            _, _, d, e1, *_ = base_parameters(self._Z, rig.L1, rig.g).tolist()
            self.mount = CompliantMount(config.mount, (e1 / rig.g, d / rig.L1))
        if idle := [name for name in config.effects if not self._can_act(name)]:
            lacking = "[arm_drive]" if moves else "an arm that moves"
            raise ConfigError(f"plant {config.name}: effects: {', '.join(idle)} need {lacking}")
        if config.effects:
            self._look_for_effects_on_reading()

    def _can_act(self, name: str) -> bool:
        """Return whether the mode of the arm permits an effect; effects of other joints are always permitted."""
        if name not in EFFECTS or not EFFECTS[name].of_arm:
            return True  # unknown names are refused when the parameters are read
        return self._setup.torques is not None if EFFECTS[name].driven else self._setup.arm_moves

    def _look_for_effects_on_reading(self) -> None:
        model, _ = self._moving
        self.pace = read_at(1.0, model)[0]
        self.delay = float(np.subtract(*read_at(0.0, model)))
        self.arm_delay = arm_lateness(model)
        self.has_play = model.required.play or model.required.play1
        if not max(abs(self.delay), abs(self.arm_delay)) < BLOCK_TIME:
            effects = self.config.effects
            timing = [name for name in effects if EFFECTS[name].stage in ("timing", "timing0")]
            late = [f"{name}.{p}" for name in timing for p in effects[name]]
            raise ConfigError(f"plant {self.config.name}: effects: {', '.join(late)} must be below {BLOCK_TIME:g} s")

    @cached_property
    def _moving(self) -> tuple[RigModel, int]:
        """Rig for `integrate`, and mode of its arm.

        The kernels are compiled at the first access.
        """
        of_arm = self.config.arm
        back_emf = self.config.arm_drive.back_emf if self.config.arm_drive is not None else 0.0
        mode = "clamped" if of_arm.mode == "clamped" else "free"  # a known torque drives a free arm
        arm = ArmParameters(of_arm.J0, of_arm.c0 + back_emf, of_arm.k0, mode)
        try:
            effects = effects_of_run(effect_params(self.config.effects), self._setup)
            return rig_model(self._Z, self._frame, arm, effects, self._constants)
        except ValueError as error:
            raise ConfigError(f"plant {self.config.name}: effects: {error}") from error

    def refuse_drives(self) -> None:
        """Refuse joint drives if they could not produce exactly the reported torques.

        Raises:
            ConfigError: a rod is not mounted, the mount is compliant, or an effect of the plant belongs to drives.
        """
        if self._setup.held:
            raise ConfigError(f"plant {self.config.name}: drives need both rods mounted")
        if self.mount is not None:
            raise ConfigError(f"plant {self.config.name}: mount: a rig with drives needs a rigid mount")
        rippling = [
            effect.name for j, effect in enumerate((DETENT_JOINT1, DETENT_JOINT2)) if any(self.config.drives.ripple[j])
        ]
        if doubled := [name for name in rippling if name in self.config.effects]:
            raise ConfigError(
                f"plant {self.config.name}: effects: drives with torque ripple cannot also have {', '.join(doubled)}"
            )
        if of_drives := [name for name in self.config.effects if EFFECTS[name].driven]:
            raise ConfigError(f"plant {self.config.name}: effects: simulated drives have no {', '.join(of_drives)}")

    def let_go(self, theta: Theta, omega: Theta, rate_hz: float, release: int, driven: Driven | None = None) -> "Swing":
        """Release the rods with the angles theta and speeds omega (3,).

        The swing is read at `rate_hz`, and driven at these ticks.
        """
        return Swing(self, theta, omega, rate_hz, driven)

    def counted(self, counts: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the readings (n, 3) of the counters, which are the counts: these counters have no errors."""
        return counts

    def start(self, theta: Theta, omega: Theta) -> AnyState:
        """Return the state of rods that are released with the angles theta and speeds omega (3,).

        A clamped arm does not move.
        """
        at_rest = 0.0 if self._moving[1] == CLAMPED else float(omega[0])
        return at_release([*theta, at_rest, omega[1], omega[1 if self._setup.held else 2]])

    def free_states(self, state: AnyState, t: Theta) -> NDArray[np.float64]:
        """Return the states (n, 6 + internal), as in `RigState`, at true times `t` (n,) since the release."""
        return integrate(*self._moving, state, t, MAX_STEP)

    def driven_states(self, state: AnyState, t: Theta, torques: Theta) -> NDArray[np.float64]:
        """Return the states at true times, as `free_states` does, under known torques (n - 1, ...), N m.

        The torques are constant from each instant to the next.
        """
        if self.config.arm_drive is not None:  # torques (n - 1, 1) of the arm
            return integrate(*self._moving, state, t, MAX_STEP, np.append(torques[:, 0], 0.0))
        changes = 1 + np.flatnonzero((np.diff(torques, axis=0) != 0).any(axis=1))
        (model, mode), ripple = self._driven, np.array(self.config.drives.ripple)
        states = [as_row(state)[None]]
        for first, last in pairwise([0, *changes.tolist(), len(torques)]):
            params = model.params.copy()
            params[CONSTANT] += torques[first]
            params[RIPPLE] += torques[first][:, None] * ripple
            part = integrate(model._replace(params=params), mode, state, t[first : last + 1], MAX_STEP)
            state = as_state(part[-1])
            states.append(part[1:])
        return np.concatenate(states)

    @cached_property
    def _driven(self) -> tuple[RigModel, int]:
        """Rig and mode as in `_moving`, with active effects through which the drives act on the joints."""
        model, mode = self._moving
        pushed = model.params.copy()
        pushed[CONSTANT] = 1.0
        still = model.params.copy()
        for joint, shares in enumerate(self.config.drives.ripple):
            if any(shares):
                pushed[RIPPLE[joint]] = 1.0
                pushed[RIPPLE_ORDER[joint]] = still[RIPPLE_ORDER[joint]] = self.config.drives.ripple_order
        return model_with(model.base, model.constants, model.arm, pushed)._replace(params=still), mode

    def at_encoders(self, states: Theta) -> Theta:
        """Return the states (n, ...) at the encoders.

        The arm's encoder is on its motor. If backlash separates motor and arm, angle and speed are those of the motor.
        """
        if not self._moving[0].required.play0 or self._moving[1] == CLAMPED:
            return states
        angle, speed, _ = motors_of(states).T
        return np.column_stack([angle, states[:, 1:JOINTS], speed, states[:, JOINTS + 1 :]])

    def joint2(self, theta1: Theta, theta2: Theta) -> Theta:
        """Return the angle of joint 2 as read by its encoder, rad."""
        return theta2 - self._constants.relative2 * theta1

    def with_joint2(self, theta: Theta, angle2: Theta) -> Theta:
        """Return the absolute angles (n, 3) whose joint 2 has the angles `angle2` (n,) as read by its encoder, rad."""
        return np.column_stack([theta[:, :2], angle2 + self._constants.relative2 * theta[:, 1]])

    def held(self, angles: Theta, hold: Theta) -> Theta:
        """Return the angles (n, 2) of encoders with play while joints 1 and 2 move through `angles`, rad."""
        return held_along(angles, hold, self._moving[0])

    def misread(self, theta: Theta, t: Theta, run: int) -> Theta:
        """Return the angles (n, 3) with encoder errors, at the device times `t` (n,) since a release.

        `run` is the number of the release.
        """
        angles = np.column_stack([theta[:, 1], self.joint2(theta[:, 1], theta[:, 2]), theta[:, 0]])
        if self.config.effects:
            apply_encoder_errors(angles, t, run, self._moving[0])
        return self.with_joint2(angles[:, [2, 0]], angles[:, 1])

    def reveal(self) -> dict[str, dict[str, object]]:
        """Return the true parameters, ratios and effects of the plant."""
        _, L1, g = self._frame
        true_ratios = ratios(base_parameters(self.config.Z, L1, g))
        return {
            "parameters": dict(self.config.parameters),
            "ratios": dict(zip(RATIOS, true_ratios.tolist(), strict=True)),
            "effects": {name: dict(values) for name, values in self.config.effects.items()},
            "arm": self.config.arm.model_dump(),
            **({"arm_drive": self.config.arm_drive.model_dump()} if self.config.arm_drive is not None else {}),
            **({"mount": self.config.mount.model_dump()} if self.config.mount is not None else {}),
        }


class Swing:
    """Swing after one release: angles at the encoders, computed in blocks.

    Each block starts from the final state of the previous block. The same release therefore gives identical numbers
    for any sequence of reads.
    """

    def __init__(self, plant: Plant, theta: Theta, omega: Theta, rate_hz: float, driven: Driven | None = None) -> None:
        self._blocks = _shown(plant, theta, omega, rate_hz, driven)
        self.first = 0
        """Earliest tick that can still be read."""
        self._rows = next(self._blocks)

    def theta(self, first: int, count: int) -> Theta:
        """Return the angles (count, 3) at the ticks `first`, `first` + 1, ... since the release, rad.

        Raises:
            ValueError: `first` is before the last read tick; a swing can only be read forwards.
        """
        return self._read(first, count)[:, :JOINTS]

    def asked(self, first: int, count: int) -> Theta:
        """Return the inputs (count,) that the program of the arm requested at these ticks; zeros without a drive."""
        return self._read(first, count)[:, JOINTS]

    def _read(self, first: int, count: int) -> Theta:
        if first < self.first:
            raise ValueError(f"the swing was read up to tick {self.first}, not back to {first}")
        while self.first + len(self._rows) < first + count:
            self._rows = np.concatenate([self._rows, next(self._blocks)])
            passed = min(first - self.first, len(self._rows))
            self.first, self._rows = self.first + passed, self._rows[passed:]
        return self._rows[first - self.first :][:count]


def _shown(plant: Plant, theta: Theta, omega: Theta, rate_hz: float, driven: Driven | None) -> Iterator[Theta]:
    """Yield blocks (ticks, 4) with three angles and the requested input.

    The angles contain the delays and the backlash of the encoders.
    """
    rate_hz /= plant.pace
    if plant.delay == 0.0 and plant.arm_delay == 0.0 and not plant.has_play:
        looks = 1 if plant.mount is None else _fine(rate_hz)
        blocks = _blocks(plant, theta, omega, rate_hz, looks, driven)
        yield from (np.column_stack([block.states[:-1:looks, :JOINTS], block.asked]) for block in blocks)
    looks = _fine(rate_hz)
    blocks = _blocks(plant, theta, omega, rate_hz, looks, driven)
    hold = np.array([theta[1], plant.joint2(theta[1], theta[2])])
    around = [next(blocks), next(blocks)]
    this = 0
    while True:
        t, states, asked = around[this]
        angle0 = _seen_at(around, lambda rows: rows[:, 0], t - plant.arm_delay) if plant.arm_delay else states[:, 0]
        held = plant.held(np.column_stack([states[:, 1], _joint2_at(plant, around, t - plant.delay)]), hold)
        hold = held[-1]
        theta01 = np.column_stack([angle0, held[:, 0]])[:-1:looks]
        yield np.column_stack([plant.with_joint2(theta01, held[:-1:looks, 1]), asked])
        around = [*around[-2:], next(blocks)]
        this = 1


def _fine(rate_hz: float) -> int:
    """Return the number of sampling points per tick with a spacing of at most `LOOK`."""
    return max(1, math.ceil(1.0 / (rate_hz * LOOK)))


def _joint2_at(plant: Plant, blocks: list[Block], t: Theta) -> Theta:
    """Return the angle (n,) of joint 2 at the true times `t`; it is constant before the release."""
    return _seen_at(blocks, lambda of: plant.joint2(of[:, 1], of[:, 2]), t)


def _seen_at(blocks: list[Block], angle: Callable[[Theta], Theta], t: Theta) -> Theta:
    """Interpolate a linear function of the angles (m, 3) at the true times `t` (n,).

    Before the release the result is constant.
    """
    from scipy.interpolate import CubicHermiteSpline  # slow to import, and few plants need it

    instants = np.concatenate([block.t[:-1] for block in blocks])
    states = np.concatenate([block.states[:-1] for block in blocks])
    spline = CubicHermiteSpline(instants, angle(states[:, :JOINTS]), angle(states[:, JOINTS : 2 * JOINTS]))
    return spline(np.maximum(t, 0.0))


def _blocks(
    plant: Plant, theta: Theta, omega: Theta, rate_hz: float, looks: int, driven: Driven | None
) -> Iterator[Block]:
    """Yield the blocks of a swing with `looks` sampling points per tick.

    Each block starts from the end of the previous one.
    """
    ticks = max(1, round(BLOCK_TIME * rate_hz))
    instants = np.arange(ticks * looks + 1) / (rate_hz * looks)
    state, first, moved, asked = plant.start(theta, omega), 0, AT_REST, np.zeros(0)
    while True:
        t = first / rate_hz + instants
        if plant.mount is not None:
            torques, moved = plant.mount.torques(t, plant.free_states(state, t), moved)
            states = plant.driven_states(state, t, torques)
        elif driven is None:
            states = plant.free_states(state, t)
        elif plant.config.arm_drive is not None:
            states, asked = driven(plant.driven_states, state, t, ticks, asked=asked)
        else:
            states = plant.driven_states(state, t, np.repeat(driven(first, ticks), looks, axis=0))
        requested = asked[first:] if len(asked) else np.zeros((len(states) - 1) // looks)
        yield Block(t, plant.at_encoders(states), requested)
        state, first = as_state(states[-1]), first + ticks
