"""MuJoCo's own system identification toolbox on the recordings of `benchmarks/identify.py`.

    python -m pip install "mujoco[sysid]>=3.5"
    python benchmarks/mujoco_sysid.py [--quick] [--json] [--rigs N]

The toolbox fits all nine parameters by box-constrained Gauss-Newton, from the middle of the box. It takes start
states as given, so it gets segments that start from the smoothed states, as the search of `dpr-lab` does; the local
solver of `dpr-lab`, beside it, starts from the same point and estimates start states as well. Ratios are compared:
a free swing fixes nothing else.

error        median over rigs of the largest relative error of the five ratios
over bound   median over rigs of the error over the Cramer-Rao bound, root mean square of the five ratios
"""

import contextlib
import io
import json
import logging
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np
from _bars import options
from _random_rigs import BOXES, Array, Trial, boxed, draw

from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.estimation.segments import Segment, cut
from dpr_lab.identify import polish
from dpr_lab.rig import PARAMETERS, Rig

try:
    import mujoco
    from mujoco import sysid
    from mujoco.sysid import SignalType, optimize
except ImportError as missing:
    print(f"not measured: MuJoCo's sysid toolbox is not installed ({missing}); pip install 'mujoco[sysid]>=3.5'")
    sys.exit(0)

STEP = 0.0025
SEGMENTS_S = (0.25, 1.0)

RODS = """
<mujoco model="rods">
  <option integrator="RK4" timestep="{step}" gravity="0 0 -{g}"><flag contact="disable"/></option>
  <worldbody>
    <body name="inner">
      <joint name="joint1" type="hinge" axis="0 1 0"/>
      <inertial pos="0 0 0.2" mass="0.1" diaginertia="0.00133 0.00133 0.0005"/>
      <body name="encoder" pos="0 0 {L1}">
        <inertial pos="0 0 0" mass="0.208" diaginertia="1e-9 1e-9 1e-9"/>
      </body>
      <body name="outer" pos="0 0 {L1}">
        <joint name="joint2" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 0.2" mass="0.1" diaginertia="0.00133 0.00133 0.0005"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="idle" joint="joint1"/></actuator>
</mujoco>
"""


@dataclass(frozen=True, slots=True)
class Row:
    """All rigs of one box and program."""

    box: str
    program: str
    seconds: float
    error: float
    over_bound: float


def write(spec: "mujoco.MjSpec", name: str, value: float) -> None:
    """One of the nine parameters into MuJoCo's model; rods lie along z."""
    kind, index = name[0], name[1]
    body = spec.body({"1": "inner", "2": "outer", "b": "encoder"}[index])
    if kind == "m":
        body.mass = value
    elif kind == "l":
        body.ipos = [0.0, 0.0, value]
    elif kind == "J":
        body.inertia = [value, value, value / 2]  # the third swings nothing
    else:
        coefficients = np.zeros_like(spec.joint(f"joint{index}").damping)  # a polynomial in speed since MuJoCo 4
        coefficients.flat[0] = value
        spec.joint(f"joint{index}").damping = coefficients


def parameters_of(rig: Rig) -> "sysid.ParameterDict":
    """The nine parameters with the box's bounds, at its middle."""
    declared = sysid.ParameterDict()
    for name, lower, upper in zip(PARAMETERS, *rig.bounds, strict=True):
        declared.add(
            sysid.Parameter(
                name,
                (lower + upper) / 2,
                lower,
                upper,
                modifier=lambda spec, parameter, name=name: write(spec, name, float(parameter.value[0])),
            )
        )
    return declared


def sequences(pieces: list[Segment], rig: Rig) -> "sysid.ModelSequences":
    """Segments with their start states, in joint angles."""
    spec = mujoco.MjSpec.from_string(RODS.format(step=STEP, g=rig.rig.g, L1=rig.rig.L1))
    model = spec.compile()
    observed = [("joint1", SignalType.MjStateQPos), ("joint2", SignalType.MjStateQPos)]
    starts, idle, angles = [], [], []
    for piece in pieces:
        t, start = piece.t - piece.t[0], piece.start
        joints = np.column_stack([piece.theta[:, 0], piece.theta[:, 1] - piece.theta[:, 0]])
        qpos, qvel = np.array([start[0], start[1] - start[0]]), np.array([start[2], start[3] - start[2]])
        starts.append(sysid.create_initial_state(model, qpos, qvel))
        idle.append(sysid.TimeSeries(t, np.zeros((len(t), 1))))
        angles.append(sysid.TimeSeries.from_names(t, joints, model, observed))
    names = [f"segment {i}" for i in range(len(pieces))]
    return sysid.ModelSequences("rods", spec, names, starts, idle, angles, allow_missing_sensors=True)


def toolbox(trial: Trial, rig: Rig, length: float) -> Array:
    """(5,) ratios that the toolbox finds."""
    pieces = [s for i, e in enumerate(trial.evidence) for s in cut(i, e.run, e.states, length)]
    residual = sysid.build_residual_fn(models_sequences=[sequences(pieces, rig)])
    with contextlib.redirect_stdout(io.StringIO()):  # it prints every iteration
        found, _ = optimize(parameters_of(rig), residual, verbose=False, max_iters=60)
    Z = np.array([found[name].value[0] for name in PARAMETERS])
    return ratios(base_parameters(Z, rig.rig.L1, rig.rig.g))


def measure(seeds: range) -> list[Row]:
    """Both programs in every box."""
    trials = [draw(seed) for seed in seeds]
    programs = {f"mujoco.sysid, {length:g} s segments": length for length in SEGMENTS_S} | {"dpr-lab, no search": None}
    table = []
    for box in BOXES:
        rig = boxed(box)
        for name, length in programs.items():
            seconds, errors, bounds = [], [], []
            for trial in trials:
                began = time.perf_counter()
                if length is None:
                    found = polish(rig.bounds.mean(axis=0), trial.evidence, rig).ratios
                else:
                    found = toolbox(trial, rig, length)
                seconds.append(time.perf_counter() - began)
                errors.append(np.abs(found / trial.ratios - 1).max())
                bounds.append(np.sqrt(np.mean(((found - trial.ratios) / trial.cramer_rao_std) ** 2)))
            table.append(Row(box, name, *(float(np.median(values)) for values in (seconds, errors, bounds))))
            print(f"{box}, {name}: done", file=sys.stderr)
    return table


def main() -> None:
    """Measure and print."""
    parser = options(__doc__)
    parser.add_argument("--rigs", type=int, default=3)
    chosen = parser.parse_args()
    logging.disable(logging.WARNING)  # the toolbox warns of every segment that observes states, not sensors
    table = measure(range(1 if chosen.quick else chosen.rigs))
    if chosen.json:
        print(json.dumps([asdict(row) for row in table], indent=2))
        return
    print(f"{'box':<9} {'program':<30} {'seconds':>8} {'error':>8} {'over bound':>10}")
    for row in table:
        print(f"{row.box:<9} {row.program:<30} {row.seconds:>8.1f} {row.error:>8.1e} {row.over_bound:>10.1f}")
    print(f"mujoco {mujoco.__version__}")


if __name__ == "__main__":
    main()
